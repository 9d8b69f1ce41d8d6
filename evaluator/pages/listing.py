"""What the list of scenes says of a pack: public facts, picked one by one.

No answer, knob, range, reason or hidden object passes: a private field added to packs tomorrow stays private.
"""

from dataclasses import dataclass
from typing import Self

from scenes import AnswerSpec, Category, Pack, PackFiles


@dataclass(frozen=True, slots=True)
class Steps:
    """How long the reference protocol is: the least and the most over several seeds.

    Where a protocol goes on until it knows, its length at one seed would tell of the answer at that seed.
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
    """How many objects an agent knows from the start; how many are hidden is not told."""
    steps: Steps | None
    """None where the reference protocol does not run."""

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
