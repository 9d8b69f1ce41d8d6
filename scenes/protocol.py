"""Functions for writing reference protocols, which call public tools. Each `yield` of `solve` is an iteration.

    def solve(task):
        \"\"\"Weigh the puck with one known push.\"\"\"
        readings = yield [call("apply_force", object_id="object_1", force_vector=[2, 0, 0]), call("step", duration=0.1)]
        ...
        yield [answer(value)]

A `yield` returns a list with a dict for each call: the structured result, `{"error": sentence}` for a refused call, or
`{}` for a call that was not run.

A pack that asks for a prediction may define `predict(structure, constants)`, which computes the answer from the law of
a structure, instead of `structure` and `theory`. `load_solution` then derives these two from the sampled values.
"""

import re
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from scenes.answer_spec import Scalar
from scenes.draw import KnobValue
from scenes.errors import PackError
from scenes.folder import PackFiles
from scenes.pack import Knob

ANSWER = "answer"
_FUNCTIONS = ("solve", "theory", "measure", "structure", "fit", "naive", "batch", "rivals", "settles", "generated")
_STAGE = re.compile(r"stage(_\w+)?")

KIND = "kind"
"""Name of the knob whose value is the label of the structure, unless `solution.py` defines `structure`."""

Reading = dict[str, Any]
AnswerValue = Scalar | list[Scalar]


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a public tool."""

    tool: str
    arguments: dict[str, Any] = field(default_factory=dict[str, Any])


Protocol = Generator[list[Call], list[Reading], None]
Exchanges = Sequence[tuple[Call, Reading]]
"""Calls with their results, in order."""


@dataclass(frozen=True, slots=True)
class Member:
    """The best fit of one of the laws that a task lists, computed by `scenes.family`."""

    chi_square: float
    """Sum of the squared misfits, each divided by the standard deviation of reading and computed value together."""
    readings: int
    """Number of misfits. It is the same for all members of a family that are compared."""
    constants: int
    """Number of fitted constants."""
    answer: AnswerValue
    """The answer computed with the best-fit constants."""
    plausible: Callable[[int], list[AnswerValue]]
    """Returns a number of answers, computed with constants that are drawn from their distribution given the readings.
    """


@dataclass(frozen=True, slots=True)
class Generated:
    """The hidden constants of a pack without knobs whose model is generated from them."""

    knobs: Mapping[str, Knob]
    """Their ranges. The canonical value of each is that of the pack."""
    mjcf: Callable[[Mapping[str, KnobValue]], str]
    """Returns the model with other values of all constants."""


@dataclass(frozen=True, slots=True)
class Solution:
    """The functions that `solution.py` defines."""

    solve: Callable[[str], Protocol] | None
    """Reference protocol: takes the opening prompt, yields calls, receives readings."""
    theory: Callable[[Mapping[str, KnobValue]], AnswerValue] | None
    """Computes the answer from the drawn values, by a formula."""
    measure: Callable[[Any, Mapping[str, KnobValue]], AnswerValue] | None
    """Computes the answer by a run of the engine without permissions, from the drawn world and the drawn values."""
    structure: Callable[[Mapping[str, KnobValue]], str] | None = None
    """Returns the label of the structure that was drawn."""
    fit: Callable[[Exchanges, str], AnswerValue] | None = None
    """Fits the model of a structure to the calls and readings of the reference protocol; returns the answer."""
    naive: Callable[[Mapping[str, KnobValue]], Mapping[str, AnswerValue]] | None = None
    """Computes the wrong answers of plausible shortcuts, by name, from the drawn values."""
    batch: Callable[[str], Protocol] | None = None
    """The best attempt with one fixed list of at most 60 calls: yields them once, then the answer."""
    rivals: Callable[[Exchanges], Mapping[str, Member]] | None = None
    """Fits every member of the stated family of laws to calls and readings; returns them by the label of their
    structure."""
    settles: Callable[[Any, Mapping[str, KnobValue], float], float] | None = None
    """Tests the stability of the equilibrium in the question. Starts the drawn world with this relative deviation,
    under constant loads and without a controller, and returns its relative error after a long time."""
    generated: Generated | None = None
    """The constants of a pack that was generated, as a world is."""
    stages: Mapping[str, Callable[[str], Protocol]] = field(default_factory=dict[str, Callable[[str], Protocol]])
    """The most direct attempts to produce the situation of the question, by name: `stage` and `stage_…`."""


def call(tool: str, **arguments: Any) -> Call:
    """Return a call of a tool."""
    return Call(tool, arguments)


def answer(value: AnswerValue, **steps: float) -> Call:
    """Return the call with the final answer and the intermediate quantities that the scene names."""
    return Call(ANSWER, {"answer": value, "steps": steps} if steps else {"answer": value})


def with_law(asked: Call, law: Mapping[str, Any] | None) -> Call:
    """Return the answering call with a law added; unchanged if the law is None."""
    return asked if law is None else Call(asked.tool, {**asked.arguments, "law": dict(law)})


def drawn_kind(knobs: Mapping[str, KnobValue]) -> str:
    """Return the value of the knob `kind`: the structure of a pack whose solution does not define `structure`."""
    return str(knobs[KIND])


def load_solution(files: PackFiles) -> Solution:
    """Import a pack's `solution.py`. This runs its code, so use it only for packs that the user named.

    In the file of a generated pack, `solve` is an object that has the functions as its attributes.
    If the file defines `predict` or `fit`, the default of `structure` is `drawn_kind`. If it defines `predict` and no
    `theory`, the default of `theory` is `predict` of the structure and the values at the seed.

    Raises:
        PackError: The pack has none, or it cannot be imported.
    """
    defined = vars(imported(files.solution, f"physment_solution_{files.scene_id}"))
    solve = defined.get("solve")
    defined = {**defined, **{name: getattr(solve, name) for name in _FUNCTIONS if hasattr(solve, name)}}
    stages = {name: made for name, made in defined.items() if _STAGE.fullmatch(name)}
    return Solution(**{name: defined.get(name) for name in _FUNCTIONS} | _derived(defined), stages=stages)


def imported(path: Path, name: str) -> ModuleType:
    """Import a file of a pack. This runs the code of the file.

    Args:
        path: The file.
        name: Name of the module.

    Raises:
        PackError: There is no such file, or it cannot be imported.
    """
    spec = spec_from_file_location(name, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise PackError(path, "no such file: this pack has no reference protocol")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise PackError(path, f"cannot be imported: {error!r}") from error
    return module


def _derived(defined: Mapping[str, Any]) -> dict[str, Any]:
    """The default functions that are derived from those that `solution.py` defines."""
    structure, theory, predict = (defined.get(name) for name in ("structure", "theory", "predict"))
    if structure is None and (predict is not None or "fit" in defined):
        structure = drawn_kind
    if theory is None and predict is not None and structure is not None:
        theory = _predicted(predict, structure)
    return {"structure": structure, "theory": theory}


def _predicted(
    predict: Callable[[str, Mapping[str, KnobValue]], AnswerValue], structure: Callable[[Mapping[str, KnobValue]], str]
) -> Callable[[Mapping[str, KnobValue]], AnswerValue]:
    def theory(knobs: Mapping[str, KnobValue]) -> AnswerValue:
        return predict(structure(knobs), knobs)

    return theory
