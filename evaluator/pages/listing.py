"""The public facts of a pack for the list of scenes, selected field by field.

Answers, knobs, ranges, reasoning and hidden objects are left out. A private field added to packs later stays private.
"""

from dataclasses import dataclass
from typing import Self

from scenes import AnswerSpec, Category, Pack, PackFiles


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
    """Kind and unit, in words."""
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
            answer=_answer_type(pack.answer_spec),
            in_sight=sum(not pack.permissions_of(key).hidden for key in pack.objects),
            steps=steps,
        )


def _answer_type(spec: AnswerSpec | None) -> str:
    if spec is None:
        return ""
    if spec.options:
        return f"{spec.kind.value}, {len(spec.options)} options"
    if spec.unit is None:
        return spec.kind.value
    units = spec.unit if isinstance(spec.unit, tuple) else (spec.unit,)
    many = f"{max(len(units), len(spec.labels))} " if spec.kind == "numbers" else ""
    return f"{many}{spec.kind.value}, {', '.join('no unit' if unit == '1' else unit for unit in units)}"
