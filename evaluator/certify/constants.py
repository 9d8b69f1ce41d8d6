"""The hidden constants of a seed, constants close to them, and the sensitivity of the answer to them."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from evaluator.certify.probing import Array, NotMeasurable
from evaluator.certify.subject import Draw, Subject
from evaluator.records.evidence import CERTAIN, SUFFICIENT
from physment_mcp.errors import SceneError
from scenes import KnobValue, Scalar
from scenes.draw import evaluate
from scenes.pack import Knob
from scenes.protocol import AnswerValue

_STEP = 1e-3
"""Step of the numerical gradient of the answer, as a share of the constant's range."""
_SAMPLES = 100
"""Number of sampled sets of constants from which the probability of a choice is estimated."""


@dataclass(frozen=True)
class Constants:
    """The hidden values of an episode: continuous ones, in units of their ranges, and discrete ones."""

    subject: Subject
    knobs: Mapping[str, KnobValue]
    """Drawn values by knob, without derived values."""
    names: tuple[str, ...]
    """Names of the continuous constants."""

    @classmethod
    def of(cls, subject: Subject, seed: int) -> "Constants":
        """Return the constants that a seed draws, or those of a generated pack."""
        knobs, made = subject.knobs, subject.solution.generated
        drawn = {name: knob.canonical for name, knob in knobs.items()} if made else subject.draw(seed).knobs
        return cls(
            subject, {name: drawn[name] for name in knobs}, tuple(name for name, knob in knobs.items() if span(knob))
        )

    def values(
        self, shifts: Mapping[str, float] | None = None, discrete: Mapping[str, KnobValue] | None = None
    ) -> dict[str, KnobValue]:
        """Return all hidden values, including derived ones.

        Args:
            shifts: Continuous constant → share of its range by which it is shifted.
            discrete: Discrete constant → value to use in place of the sampled one.
        """
        values = {**self.knobs, **(discrete or {})}
        for name, by in (shifts or {}).items():
            values[name] = shifted(self.subject.knobs[name], float(cast("float", self.knobs[name])), by)
        for name, expression in self.subject.pack.derive.items():
            values[name] = evaluate(self.subject.files, f"derive.{name}", expression, values)
        return values

    def mjcf(self, shifts: Mapping[str, float] | None = None, discrete: Mapping[str, KnobValue] | None = None) -> str:
        """The model with these values."""
        return self.subject.mjcf(self.values(shifts, discrete))

    def answer(
        self, shifts: Mapping[str, float] | None = None, discrete: Mapping[str, KnobValue] | None = None
    ) -> list[Scalar]:
        """Compute the parts of the answer for these values.

        Raises:
            NotMeasurable: The values have no answer.
        """
        values = self.values(shifts, discrete)
        theory = self.subject.solution.theory
        try:
            if theory is not None:
                found = theory(values)
            else:
                found = cast("AnswerValue", self.subject.measured(Draw(values, self.subject.mjcf(values))))
        except (ArithmeticError, LookupError, ValueError, SceneError) as error:
            raise NotMeasurable(f"the answer cannot be computed beside the drawn values: {error!r}") from error
        return list(found) if isinstance(found, list | tuple) else [found]

    @functools.cached_property
    def key(self) -> list[Scalar]:
        """The parts of the answer at the sampled values."""
        return self.answer()

    @functools.cached_property
    def _asked(self) -> tuple[tuple[int, ...], Array, Array]:
        """Return the numeric parts of the answer, their gradients (parts, constants), and their tolerances."""
        chosen = self.subject.spec.options
        parts = tuple(n for n, part in enumerate(self.key) if not chosen and isinstance(part, int | float))
        gradient = np.zeros((len(parts), len(self.names)))
        for column, name in enumerate(self.names):
            above, below = self.answer({name: _STEP}), self.answer({name: -_STEP})
            gradient[:, column] = [
                (float(above[part]) - float(below[part])) / (2 * _STEP)  # shifted constants give numbers, too
                for part in parts
            ]
        spec = self.subject.spec
        sizes = np.array([abs(float(self.key[part])) for part in parts])
        tolerance = np.maximum(spec.abs_tol + spec.rel_tol * sizes, 1e-12)
        if not np.isfinite(gradient).all():
            raise NotMeasurable("the answer has no gradient at the drawn values")
        return parts, gradient, tolerance

    def bounds(self, fisher: Array) -> list[float]:
        """Return the Cramér-Rao bound of each requested number's standard error, divided by its tolerance.

        Args:
            fisher: Fisher information on the continuous constants.
        """
        parts, gradient, tolerance = self._asked
        if not parts or not self.names:
            return [0.0 for _ in parts]
        variance = np.einsum("pi,ij,pj->p", gradient, np.linalg.inv(fisher), gradient)
        return [float(bound) for bound in np.sqrt(np.maximum(variance, 0.0)) / tolerance]

    def steps(self, fisher: Array) -> Array:
        """Return shifts of the constants by one standard error of each requested number (numbers, constants).

        Of all shifts that the readings distinguish equally well from none, such a shift changes the number most. If no
        number is requested, the only shift is one standard error in the least determined direction.
        """
        _, gradient, _ = self._asked
        if not self.names:
            return np.zeros((0, 0))
        covariance = np.linalg.inv(fisher)
        if not len(gradient):
            variances, axes = np.linalg.eigh(covariance)
            return (axes[:, -1] * np.sqrt(variances[-1]))[None]
        along = gradient @ covariance
        errors = np.sqrt(np.einsum("pi,pi->p", along, gradient))
        return along / np.where(errors > 0, errors, 1.0)[:, None]

    def unpredicted(self, shift: Mapping[str, float], further: Array, fisher: Array) -> list[float]:
        """Return the non-linearity of each requested number over a shift, divided by its bound.

        Args:
            shift: Continuous constant → share of its range by which it is shifted.
            further: Shift that has the same effect on the readings as the non-linear part of `shift`.
            fisher: Fisher information on the continuous constants, which determines the bounds.
        """
        parts, gradient, tolerance = self._asked
        if not parts:
            return []
        found = self.answer(shift)
        linear = gradient @ (np.array(list(shift.values())) + further)
        actual = np.array([float(found[part]) - float(self.key[part]) for part in parts])
        bounds = np.maximum(self.bounds(fisher), 1e-12)
        return list(np.nan_to_num(np.abs(actual - linear) / tolerance / bounds, nan=np.inf))

    def are_known(self, fisher: Array) -> bool:
        """Return whether numbers are known to within `SUFFICIENT` tolerances and choices with probability `CERTAIN`."""
        if max(self.bounds(fisher), default=0.0) > SUFFICIENT:
            return False
        chance = self.choice_probability(fisher)
        return chance is None or chance >= CERTAIN

    def choice_probability(self, fisher: Array) -> float | None:
        """Return the probability that the best choice is right; None if only numbers are asked for."""
        if len(self._asked[0]) == len(self.key):
            return None
        if not self.names:
            return 1.0
        root = np.linalg.cholesky(np.linalg.inv(fisher))
        normal = np.random.default_rng(0).standard_normal((_SAMPLES, len(self.names)))
        right = 0
        for row in normal @ root.T:
            found = self.answer(self._within(row))
            right += all(
                str(got) == str(want)
                for part, (got, want) in enumerate(zip(found, self.key, strict=True))
                if part not in self._asked[0]
            )
        return right / _SAMPLES

    def _within(self, shifts: Sequence[float]) -> dict[str, float]:
        """Clip shifts so that every constant stays in its range."""
        kept: dict[str, float] = {}
        for name, shift in zip(self.names, shifts, strict=True):
            at = unit(self.subject.knobs[name], float(cast("float", self.knobs[name])))
            kept[name] = float(np.clip(at + shift, 0.0, 1.0)) - at
        return kept

    def shortened(self, step: Array) -> dict[str, float]:
        """Shorten a step, without turning it, so that every constant stays in its range."""
        ends = self._within(list(step))
        shares = [ends[name] / by for name, by in zip(self.names, step, strict=True) if by]
        share = float(np.clip(min([*shares, 1.0]), 0.0, 1.0))
        return {name: share * float(by) for name, by in zip(self.names, step, strict=True)}

    def others(self) -> Iterator[tuple[str, dict[str, KnobValue]]]:
        """Yield each change of one discrete value, with its name. A permutation changes by swapping two values."""
        for name, knob in self.subject.knobs.items():
            drawn = self.knobs[name]
            for value in knob.choice or ():
                if value != drawn:
                    yield f"{name} = {value}", {name: value}
            if knob.permutation is not None and isinstance(drawn, tuple):
                for first in range(len(drawn)):
                    for second in range(first + 1, len(drawn)):
                        swapped = list(drawn)
                        swapped[first], swapped[second] = swapped[second], swapped[first]
                        yield f"{name} = {tuple(swapped)}", {name: tuple(swapped)}


def span(knob: Knob) -> tuple[float, float] | None:
    """The range of a continuous constant; None for a discrete one."""
    return knob.uniform or knob.log_uniform


def unit(knob: Knob, value: float) -> float:
    """Position of a value in its range, from 0 to 1; on a logarithmic scale if the constant is sampled on one."""
    low, high = cast("tuple[float, float]", span(knob))
    if knob.uniform is not None:
        return (value - low) / (high - low)
    return float(np.log(value / low) / np.log(high / low))


def shifted(knob: Knob, value: float, by: float) -> float:
    """Shift a value by a share of its range."""
    low, high = cast("tuple[float, float]", span(knob))
    return value + (high - low) * by if knob.uniform is not None else value * (high / low) ** by
