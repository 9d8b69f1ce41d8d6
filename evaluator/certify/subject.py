"""The pack that is being certified: its variants, their answer keys, and the test for agreement with a key."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Self, cast

from evaluator.answers.engine import Engine, session_of
from evaluator.answers.formula import compare_formulas
from physment_mcp.session import Session
from scenes import (
    AnswerKind,
    AnswerSpec,
    KnobValue,
    Pack,
    PackError,
    PackFiles,
    Scalar,
    draw_knobs,
    drawn_mjcf,
    read_pack,
)
from scenes.pack import Knob
from scenes.protocol import AnswerValue, Solution, load_solution


@dataclass(frozen=True, slots=True)
class Draw:
    """Hidden values of one seed, and the model that contains them."""

    knobs: Mapping[str, KnobValue]
    mjcf: str


@dataclass(frozen=True)
class Subject:
    """A pack with its solution, its variants and their answer keys, as input of the certificates."""

    files: PackFiles
    pack: Pack
    solution: Solution
    spec: AnswerSpec

    @classmethod
    def open(cls, files: PackFiles) -> Self:
        """Read a pack and run its `solution.py`.

        Raises:
            PackError: A file is missing or malformed, or the pack does not declare something a certificate needs.
        """
        pack, solution = read_pack(files), load_solution(files)
        if pack.answer_spec is None or pack.category is None:
            raise PackError(files.json, "answer_spec and category are needed to certify a scene")
        if solution.solve is None or (solution.theory is None and solution.measure is None):
            raise PackError(files.solution, "define solve, and theory or measure: without them nothing can be proven")
        return cls(files, pack, solution, pack.answer_spec)

    @property
    def knobs(self) -> Mapping[str, Knob]:
        """The hidden values of the pack: its knobs, or the constants from which it was generated."""
        return self.solution.generated.knobs if self.solution.generated else self.pack.knobs

    def mjcf(self, values: Mapping[str, KnobValue]) -> str:
        """Return the model with chosen hidden values."""
        if self.solution.generated:
            return self.solution.generated.mjcf(values)
        return drawn_mjcf(self.files, self.pack, values, canonical=False)

    @functools.cached_property
    def _drawn(self) -> dict[tuple[int, str, int], Draw]:
        return {}

    def draw(self, seed: int) -> Draw:
        """The draw of a seed."""
        return self._draw(seed, "", 0)

    def twin(self, knob: str, seed: int) -> Draw:
        """Return the scene at seed 0 with the value of only one knob sampled again.

        Args:
            knob: Name of the knob.
            seed: Seed from which the new value is sampled.
        """
        return self._draw(0, knob, seed)

    def _draw(self, seed: int, knob: str, reseed: int) -> Draw:
        """Return the hidden values and the model of a seed. Cached, because several certificates need the same ones."""
        wanted = (seed, knob, reseed)
        if wanted not in self._drawn:
            knobs = draw_knobs(self.files, self.pack, seed, reseed={knob: reseed} if knob else None)
            self._drawn[wanted] = Draw(knobs, drawn_mjcf(self.files, self.pack, knobs, canonical=not (seed or knob)))
        return self._drawn[wanted]

    def session(self, draw: Draw) -> Session:
        """Open a new session with the model of a variant."""
        return session_of(self.files, draw.mjcf)

    def session_to_compare(self, draw: Draw) -> Session:
        """Return a new session of a variant without a limit of calls, so that all its readings can be compared."""
        return session_of(self.files, draw.mjcf, any_calls=True)

    def measured(self, draw: Draw, timestep: float | None = None) -> AnswerValue | None:
        """Return the answer that the engine gives for a variant; None if the pack has no `measure`."""
        if self.solution.measure is None:
            return None
        return self.solution.measure(Engine(draw.mjcf, timestep), draw.knobs)

    @functools.cached_property
    def _truths(self) -> dict[str, AnswerValue]:
        return {}

    def truth(self, draw: Draw) -> AnswerValue:
        """Return the answer key of a variant: from `theory`, or from `measure` if there is no closed form.

        Cached, because the certificates ask for it hundreds of times, and a `theory` may integrate a motion.
        """
        wanted = repr(draw)
        if wanted not in self._truths:
            theory = self.solution.theory
            self._truths[wanted] = theory(draw.knobs) if theory else cast("AnswerValue", self.measured(draw))
        return self._truths[wanted]

    def agrees(self, value: object, key: AnswerValue, share: float = 1.0) -> bool:
        """Return whether a value agrees with the key within a share of the tolerance; words must be equal."""
        pairs = list(zip_longest(_parts(value), _parts(key)))
        return all(self._part_agrees(got, want, share) for got, want in pairs)

    def _part_agrees(self, got: object, want: Scalar | None, share: float) -> bool:
        if self.spec.kind is AnswerKind.FORMULA:
            tolerance = {"rel_tol": share * self.spec.rel_tol, "abs_tol": share * self.spec.abs_tol}
            return compare_formulas(str(got), str(want), self.spec.model_copy(update=tolerance))[0]
        if isinstance(got, int | float) and isinstance(want, int | float):
            return abs(got - want) <= share * (self.spec.abs_tol + self.spec.rel_tol * abs(want))
        return got is not None and str(got) == str(want)


def gap(value: object, key: AnswerValue) -> float:
    """Return the largest relative difference between the numbers of a value and its key; 1 if words differ."""
    gaps = [
        abs(got - want) / max(abs(want), 1e-12)
        if isinstance(got, int | float) and isinstance(want, int | float)
        else float(str(got) != str(want))
        for got, want in zip_longest(_parts(value), _parts(key))
    ]
    return max(gaps)


def _parts(value: object) -> Sequence[Scalar]:
    return cast("Sequence[Scalar]", value if isinstance(value, list | tuple) else (value,))
