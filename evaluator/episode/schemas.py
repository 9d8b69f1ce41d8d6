"""Values checked against the JSON schemas that a server publishes."""

from collections.abc import Iterator, Mapping
from typing import Any

from jsonschema import Draft202012Validator, ValidationError
from pydantic import JsonValue
from referencing import Registry

_LONGEST = 300
"""Most characters of a problem that are repeated."""


def schema_validator(schema: Mapping[str, Any]) -> Draft202012Validator:
    """A validator for one schema, which may refer to parts of itself and to nothing else."""
    return Draft202012Validator(dict(schema), registry=Registry())


def first_problem(validator: Draft202012Validator, value: JsonValue) -> str:
    """What is wrong with a value, and where; empty if nothing is."""
    problems: Iterator[ValidationError] = validator.iter_errors(value)  # pyright: ignore[reportUnknownMemberType] - partly typed
    problem = next(problems, None)
    if problem is None:
        return ""
    where = ".".join(str(part) for part in problem.absolute_path)
    return f"{where + ': ' if where else ''}{problem.message[:_LONGEST]}"
