"""The public facts of a pack for the list of scenes, selected field by field.

Answers, knobs, ranges, reasoning and hidden objects are left out. A private field added to packs later stays private.
"""

from dataclasses import dataclass
from itertools import zip_longest
from typing import Self

from scenes import AnswerKind, AnswerSpec, Category, Pack, PackFiles


@dataclass(frozen=True, slots=True)
class Steps:
    """Length of the reference protocol: minimum and maximum over several seeds.

    A single seed is not enough: if a protocol continues until it knows the answer, its length would reveal the answer.
    """

    iterations: tuple[int, int]
    interventions: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Listing:
    """The public facts of a scene."""

    scene: int
    name: str
    category: Category | None
    concepts: tuple[str, ...]
    answer: str
    """Its form, in words."""
    in_sight: int
    """Number of objects that an agent knows from the start; hidden objects are not counted."""
    steps: Steps | None
    """None if the reference protocol does not run."""

    @classmethod
    def of(cls, files: PackFiles, pack: Pack, steps: Steps | None) -> Self:
        """The facts of a pack."""
        return cls(
            scene=files.scene_id,
            name=pack.metadata.scene_name,
            category=pack.category,
            concepts=pack.concepts,
            answer=answer_form(pack.answer_spec),
            in_sight=sum(not pack.permissions_of(key).hidden for key in pack.objects),
            steps=steps,
        )


def answer_form(spec: AnswerSpec | None) -> str:
    """What an answer is, in words: its kind, options or units, and tolerance; empty if the pack does not say.

    How many numbers are asked for is public only as their labels or units: the answer itself is private.
    """
    if spec is None:
        return ""
    if spec.options:
        return f"one of {len(spec.options)}: {', '.join(spec.options)}"
    if spec.kind is AnswerKind.TEXT:
        return "a sentence"
    if spec.kind is AnswerKind.NUMBERS:
        return f"{_numbers(spec)}; {_tolerance(spec)}"
    kind = f"a formula in {', '.join(spec.variables)}" if spec.kind is AnswerKind.FORMULA else "a number"
    unit = "" if spec.unit is None else f" ({_unit(spec.unit)})"
    return f"{kind}{unit}; {_tolerance(spec)}"


def _numbers(spec: AnswerSpec) -> str:
    """A list of numbers: how many, and what each of them is in which unit, as far as the pack says so."""
    count = len(spec.labels) or (len(spec.unit) if isinstance(spec.unit, tuple) else 0)
    units = spec.unit if isinstance(spec.unit, tuple) else (spec.unit,) * max(count, 1)
    named = [_unit(unit) for unit in units if unit is not None]
    if spec.labels:
        pairs = zip_longest(spec.labels, named[:count], fillvalue="")
        return f"{count} numbers: {', '.join(f'{label} ({unit})' if unit else label for label, unit in pairs)}"
    return " ".join([f"{count or 'several'} numbers", *([f"({', '.join(named)})"] if named else [])])


def _unit(unit: str | tuple[str, ...]) -> str:
    return "no unit" if unit == "1" else ", ".join((unit,) if isinstance(unit, str) else unit)


def _tolerance(spec: AnswerSpec) -> str:
    unit = f" {spec.unit}" if isinstance(spec.unit, str) and spec.unit != "1" else ""
    parts = [f"{100 * spec.rel_tol:g} %"] if spec.rel_tol else []
    parts += [f"{spec.abs_tol:g}{unit}"] if spec.abs_tol else []
    return f"within {' plus '.join(parts) or 'rounding'}"
