"""The record of a tool, and the types of tool arguments."""

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Annotated, Any, Generic, NamedTuple, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, WithJsonSchema

from physment_mcp.errors import BadArgument, quoted
from physment_mcp.mechanics import Array
from physment_mcp.session import Session
from physment_mcp.tools.results import Result

LIMIT = 1e6
"""Largest magnitude of a number argument, unless its tool says otherwise."""
LIMIT_SLACK = 1e-9
"""Relative amount by which rounding errors may exceed a limit of the scene."""


def _id_text(value: object) -> object:
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


Number = Annotated[float, Field(ge=-LIMIT, le=LIMIT)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Mass = Annotated[float, Field(gt=0, le=LIMIT, description="Mass to compute with [kg]; yours to measure or choose.")]
ObjectId = Annotated[
    str,
    BeforeValidator(_id_text),
    Field(min_length=1, max_length=64),
    WithJsonSchema(
        {
            "anyOf": [{"type": "string", "minLength": 1, "maxLength": 64}, {"type": "integer"}],
            "description": "Id of the object, such as object_1; 1 means object_1.",
        }
    ),
]


class Arguments(BaseModel):
    """Base of all argument models: strict and without extra fields, so a wrong argument is never guessed at."""

    # Validators are built at their first use, as those of the results are.
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, defer_build=True)


class NoArguments(Arguments):
    """The tool takes no arguments."""


class ObjectArguments(Arguments):
    """The tool takes one object."""

    object_id: ObjectId


class MassArguments(ObjectArguments):
    """The tool takes an object and a mass to compute with."""

    mass: Mass


A = TypeVar("A", bound=Arguments)


class Progress(NamedTuple):
    """Progress of a tool that may take noticeable time."""

    done: float
    total: float
    next_s: float = 0.0
    """Expected time of the next piece [s]."""


Pieces = Generator[Progress, float | None, Result]
"""A generator that does work in pieces: it yields before each piece and after the last, and returns the result.

`send` passes it the time that the next piece may take [s].
"""


@dataclass(frozen=True, slots=True)
class Tool(Generic[A]):
    """A published tool: its name, description, argument and result models, and its function."""

    name: str
    title: str
    description: str
    arguments: type[A]
    result: type[Result]
    run: Callable[[Session, A], Result | Pieces]
    """The function of the tool. It returns pieces if it may take noticeable wall time. The caller rolls back a
    failure."""
    reads_only: bool = False
    destructive: bool = False
    idempotent: bool = False

    def parse(self, arguments: dict[str, Any]) -> A:
        """Validate arguments by the tool's model.

        Raises:
            BadArgument: They do not fit; the message names the argument and the reason.
        """
        try:
            return self.arguments.model_validate(arguments)
        except ValidationError as error:
            raise BadArgument(f"{self.name}: {_sentence(error, self.arguments)}") from None

    def input_schema(self) -> dict[str, Any]:
        """JSON Schema of the arguments."""
        return self.arguments.model_json_schema()

    def output_schema(self) -> dict[str, Any]:
        """JSON Schema of the result."""
        return self.result.model_json_schema(mode="serialization")


def _sentence(error: ValidationError, arguments: type[Arguments]) -> str:
    """Describe what is wrong with each argument; for an argument of several types, quote its description instead."""
    fields = arguments.model_fields
    problems: dict[str, str] = {}
    for detail in error.errors(include_url=False):
        name, path = str(detail["loc"][0]), ".".join(str(part) for part in detail["loc"])
        if detail["type"] == "extra_forbidden":
            problems[name] = f"there is no argument {quoted(name)}; the arguments are {', '.join(fields) or 'none'}"
        elif detail["type"] == "missing":
            problems[name] = f"the argument {name!r} is missing"
        elif detail["type"] == "dict_type":
            problems[name] = f"{path} must be a JSON object"
        elif name in problems:
            problems[name] = f"{name} has not the right form. {fields[name].description}"
        else:
            message = detail["msg"].removeprefix("Input should be ")
            problems[name] = f"{path}: {message}" if message == detail["msg"] else f"{path} must be {message}"
    return "; ".join(list(problems.values())[:3])


def array(values: list[float]) -> Array:
    """Convert a validated list to a float array."""
    return np.array(values, dtype=np.float64)


def plain(values: Array) -> list[float]:
    """Convert an array to a list of floats; -0.0 becomes 0.0."""
    return [value + 0.0 for value in values.tolist()]
