"""Static tests of the Containerfile; the workflow builds both images."""

import json
import re
import shlex
from dataclasses import dataclass
from pathlib import Path

import pytest

from evaluator.commands.program import parsed
from physment_mcp.commands.program import parser
from tests.builders.paths import ROOT


@dataclass(frozen=True, slots=True)
class Instruction:
    """A line of a Containerfile, with the lines that continue it."""

    name: str
    rest: str

    @property
    def words(self) -> list[str]:
        """The arguments of the instruction: a JSON list, or split as by a shell."""
        return json.loads(self.rest) if self.rest.startswith("[") else shlex.split(self.rest)


def stages(recipe: Path) -> dict[str, list[Instruction]]:
    """The stages of a Containerfile by name, each with its instructions; the first of them is FROM."""
    text = re.sub(r"^#.*\n", "", recipe.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found: dict[str, list[Instruction]] = {}
    current: list[Instruction] = []
    for line in re.sub(r"\\\n\s*", "", text).splitlines():
        name, _, rest = line.partition(" ")
        if name == "FROM":
            current = found.setdefault(rest.rpartition(" AS ")[2], [])
        if name:
            current.append(Instruction(name, rest.strip()))
    return found


def only(instructions: list[Instruction], name: str) -> Instruction:
    """The one instruction of a stage that has this name."""
    (found,) = (step for step in instructions if step.name == name)
    return found


STAGES = stages(ROOT / "Containerfile")
IMAGES = ("laboratory", "evaluator")


def named(stage: str, name: str) -> list[Instruction]:
    return [step for step in STAGES[stage] if step.name == name]


def test_there_are_two_images_and_the_stage_that_builds_them() -> None:
    assert set(STAGES) == {"build", *IMAGES}


@pytest.mark.parametrize("stage", ["build", *IMAGES])
def test_every_stage_starts_from_a_python_that_is_supported(stage: str) -> None:
    (given,) = re.findall(r"^ARG PYTHON=(3\.\d+)$", (ROOT / "Containerfile").read_text(encoding="utf-8"), re.MULTILINE)
    assert f'"Programming Language :: Python :: {given}"' in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert only(STAGES[stage], "FROM").rest.startswith("docker.io/library/python:${PYTHON}-slim-")


@pytest.mark.parametrize("image", IMAGES)
def test_an_image_runs_nothing_while_it_is_built_and_runs_as_a_user_without_rights(image: str) -> None:
    """All files come from the previous stage, so the image contains no build tools and caches."""
    assert named(image, "RUN") == []
    assert only(STAGES[image], "USER").rest == "65532:65532"
    assert named(image, "HEALTHCHECK") != []
    last_copy = max(number for number, step in enumerate(STAGES[image]) if step.name == "COPY")
    assert last_copy < STAGES[image].index(only(STAGES[image], "USER"))


def test_whatever_is_installed_is_checked_against_the_lock() -> None:
    installing = [
        step.rest for step in named("build", "RUN") if "uv pip install" in step.rest or "uv build" in step.rest
    ]
    assert len(installing) == 3
    for words in installing:
        assert "--require-hashes" in words
        assert "constraints requirements.lock" in words


def test_the_programs_accept_what_the_images_start() -> None:
    laboratory = [*only(STAGES["laboratory"], "ENTRYPOINT").words, *only(STAGES["laboratory"], "CMD").words]
    assert parser().parse_args(laboratory[1:]).run
    assert only(STAGES["laboratory"], "EXPOSE").rest == laboratory[laboratory.index("--port") + 1]
    (program,) = only(STAGES["evaluator"], "ENTRYPOINT").words
    assert program.endswith("/physment-eval")
    assert parsed(["--server", "http://127.0.0.1:8000"]).run


def test_the_context_of_the_build_holds_what_is_copied_and_no_more() -> None:
    ignored = (ROOT / ".dockerignore").read_text(encoding="utf-8").splitlines()
    copied = {word for step in named("build", "COPY") for word in step.words[:-1]}
    assert ignored[0] == "*"
    assert {line.removeprefix("!") for line in ignored if line.startswith("!")} == copied
