"""Compares the results of the conformance suite with the list of expected failures."""

import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from evaluator.report.export import markdown_table
from tests.harness.conformance.suite import Result

Found = Mapping[str, Mapping[str, Result]]
"""Protocol → scenario → its result."""

KINDS = {
    "fixture": "needs a tool, resource or prompt of the suite's own test server",
    "option": "needs an optional part of the protocol that the server does not declare",
    "fault": "a fault of the server",
}
"""The categories of reasons for an expected failure."""


class Expected(BaseModel):
    """A scenario that is expected to fail."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scenario: str
    kind: Literal["fixture", "option", "fault"]
    checks: frozenset[str] = Field(min_length=1)
    """The checks that fail; all other checks of the scenario must pass."""
    reason: str = Field(min_length=10)


def read_expected(file: Path) -> dict[str, Expected]:
    """Read the list of expected failures, by scenario.

    Raises:
        ValueError: The list is malformed, or names a scenario twice.
    """
    entries = TypeAdapter(list[Expected]).validate_python(tomllib.loads(file.read_text(encoding="utf-8"))["expected"])
    twice = [name for name, count in Counter(entry.scenario for entry in entries).items() if count > 1]
    if twice:
        raise ValueError(f"named twice: {', '.join(twice)}")
    return {entry.scenario: entry for entry in entries}


def differences(found: Found, expected: Mapping[str, Expected]) -> list[str]:
    """Return the differences between results and list: unlisted failures, and listed checks that pass."""
    problems: list[str] = []
    for revision, results in found.items():
        for scenario, result in results.items():
            listed = expected[scenario].checks if scenario in expected else frozenset[str]()
            problems += [
                f"{revision} {scenario}: {check} fails and is not in the list"
                for check in sorted(result.failed - listed)
            ]
            problems += [
                f"{revision} {scenario}: {check} does not fail any more; take it from the list"
                for check in sorted(listed - result.failed)
            ]
            if not result.failed and not result.passed:
                problems.append(f"{revision} {scenario}: nothing was checked")
    ran = {scenario for results in found.values() for scenario in results}
    problems += [
        f"{scenario}: in the list, but there is no such scenario" for scenario in sorted(expected.keys() - ran)
    ]
    return problems


def page(found: Found, expected: Mapping[str, Expected], suite: str) -> str:
    """The results as a document."""
    revisions = list(found)
    ran = list(dict.fromkeys(scenario for results in found.values() for scenario in results))
    counts = ", ".join(
        f"{sum(not result.failed for result in results.values())} of {len(results)} in {revision}"
        for revision, results in found.items()
    )
    lines = [
        "# Conformance to the protocol",
        "",
        "Made by `python -m tests.harness.conformance.run`; do not edit. It runs every server scenario of the official"
        " suite"
        f" (`{suite}`) against an episode of the host, in two protocols with sessions and in the stateless one. The"
        " scenarios of extensions (skills, tasks) are left out, because the host does not offer them.",
        "",
        "The suite was written for a test server: most scenarios call tools, resources and prompts with names such as"
        " `test_image_content`, which a laboratory with a fixed set of 26 tools does not have."
        " `tests/harness/conformance/expected.toml` lists each check that therefore fails, with the reason."
        " Any other failure, and any listed check that passes, makes the command fail.",
        "",
        f"Scenarios that pass completely: {counts}. The number of passed checks is in brackets.",
        "",
        "A pass means little if a scenario accepts any well-formed reply: `tools-call-simple-text` accepts the refusal"
        " of a tool that does not exist. `make test` tests the 26 tools.",
        "",
        markdown_table(
            ("scenario", *revisions, "why not"),
            [_cells(scenario, [found[revision].get(scenario) for revision in revisions], expected) for scenario in ran],
        ),
        "",
        *(f"- *{kind}*: {meaning}." for kind, meaning in KINDS.items()),
        "- –: the scenario does not exist for this protocol.",
    ]
    return "\n".join(lines) + "\n"


def _cells(scenario: str, results: Sequence[Result | None], expected: Mapping[str, Expected]) -> list[str]:
    why = expected.get(scenario)
    return [scenario, *map(_cell, results), "" if why is None else f"*{why.kind}*: {why.reason}"]


def _cell(result: Result | None) -> str:
    if result is None:
        return "–"
    checks = result.passed + len(result.failed)
    return f"no ({result.passed} of {checks})" if result.failed else f"yes ({checks})"
