"""G, the grounding: which numbers in an agent's reasoning were measured. Pure functions of recorded episodes.

An assertion is a number that the reasoning states. The following are not assertions: a number inside a word or an
exponent, a coefficient of a formula, a count of steps, the number of an object, a number from the prompt, a number in a
statement of intent (`I will push for 0.5 s`), and a number that the agent passes as an argument of any call.

An assertion is grounded if a call of an *earlier* turn returned its value: equal at the precision written, in a
compatible unit, and with the same sign unless the text calls it a magnitude. It is derived if it follows, by arithmetic
that the text states, from numbers that are grounded, given or derived. The arithmetic is evaluated both with the
numbers as written and with the unrounded values that they stand for.
"""

import bisect
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import NamedTuple

from evaluator.quantities.spoken import Spoken, spoken_numbers
from evaluator.quantities.units import Unit, conversion
from evaluator.records.episode import Episode, Record
from evaluator.scores.evidence import (
    Derivation,
    Derived,
    ReturnedValue,
    TurnText,
    exact,
    is_planned,
    numbers_in,
    plans_in,
    returned_values,
)

_ANSWER = "answer"


class Support(Record):
    """The returned value behind an assertion."""

    turn: int
    """Index of the turn, from 0."""
    exchange: int
    """Index of the exchange within the turn, from 0."""
    path: str
    """JSON path in the returned content, such as `$.velocity[2]`."""
    value: float
    """The value that was returned at this path."""


class Assertion(Record):
    """A number that the reasoning states."""

    turn: int
    """Index of the turn, from 0."""
    start: int
    """Index of its first character in the turn's reasoning, from 0."""
    end: int
    """Index of the character after its last."""
    text: str
    """The number as written, with its unit."""
    support: Support | None
    """The latest returned value that supports it; None if none does."""
    derivation: Derivation | None = None
    """The stated arithmetic that gives the number; None if it is supported, or if there is none."""


class Grounding(Record):
    """All assertions of an episode, in order."""

    assertions: tuple[Assertion, ...]

    @property
    def share(self) -> float | None:
        """G: share of supported assertions; None if there are no assertions."""
        return self._share(self.n_supported)

    @property
    def share_with_derived(self) -> float | None:
        """G+: share of supported and derived assertions; None if there are no assertions."""
        return self._share(self.n_supported + self.n_derived)

    @property
    def n_supported(self) -> int:
        """Number of supported assertions."""
        return sum(assertion.support is not None for assertion in self.assertions)

    @property
    def n_derived(self) -> int:
        """Number of derived assertions."""
        return sum(assertion.derivation is not None for assertion in self.assertions)

    def _share(self, count: int) -> float | None:
        return count / len(self.assertions) if self.assertions else None


def grounding_of(episode: Episode) -> Grounding:
    """Find the assertions of an episode, the values that support them, and the arithmetic that derives them."""
    given = _PromptNumbers.of(episode.prompt)
    own = _own_numbers(episode)
    returned: list[ReturnedValue] = []
    derived: list[Derived] = []
    assertions: list[Assertion] = []
    for index, turn in enumerate(episode.turns):
        text, plans = TurnText(index, turn.reasoning, derived), plans_in(turn.reasoning)
        for spoken in text.numbers():
            if _is_given(spoken, given, own):
                text.know(spoken, float(spoken.value))
            elif not is_planned(plans, spoken.start):
                assertions.append(_assertion(spoken, index, text, returned))
        for position, exchange in enumerate(turn.exchanges):
            returned.extend(returned_values(exchange, index, position))
    return Grounding(assertions=tuple(assertions))


def _own_numbers(episode: Episode) -> list[Fraction]:
    """Return the sorted absolute values of all numbers in the arguments of calls other than `answer`."""
    calls = (exchange.call for turn in episode.turns for exchange in turn.exchanges)
    return sorted(
        abs(exact(value)) for call in calls if call.tool != _ANSWER for _, value in numbers_in(call.arguments)
    )


def _assertion(spoken: Spoken, turn: int, text: TurnText, returned: Sequence[ReturnedValue]) -> Assertion:
    support, derivation = None, None
    found = _support(spoken, returned)
    if found is None:
        derivation = text.derivation(spoken)
    else:
        support, value = found
        text.know(spoken, value)
    return Assertion(
        turn=turn,
        start=spoken.start,
        end=spoken.end,
        text=text.text[spoken.start : spoken.end],
        support=support,
        derivation=derivation,
    )


def _is_given(spoken: Spoken, given: "_PromptNumbers", own: Sequence[Fraction]) -> bool:
    """Whether a number comes from the prompt or from the arguments of any call of the agent.

    The values must be equal, or equal after rounding if the number has at least two significant digits (`9.8` for
    9.81). Arguments match by magnitude, because agents often omit their sign (`push with 2 N` for -2).
    """
    half_unit = spoken.half_unit if spoken.significant_digits > 1 else Fraction(0)
    size = abs(spoken.value)
    return any(
        _holds(values, spoken.value * factor, half_unit * factor) for values, factor in given.comparable(spoken)
    ) or any(_holds(own, size * factor, half_unit * factor) for factor in (Fraction(1), spoken.si_factor))


class _PromptNumbers(NamedTuple):
    """The numbers of a prompt, sorted."""

    by_unit: dict[Unit | None, list[Fraction]]
    of_any_unit: list[Fraction]
    """All numbers, as written and in coherent SI, for comparison with a number without a unit."""

    @classmethod
    def of(cls, prompt: str) -> "_PromptNumbers":
        by_unit: dict[Unit | None, list[Fraction]] = {None: []}
        for spoken in spoken_numbers(prompt):
            bisect.insort(by_unit.setdefault(spoken.unit, []), spoken.value)
        everything = {
            value * factor for unit, values in by_unit.items() for value in values for factor in _scales(unit)
        }
        return cls(by_unit, sorted(everything))

    def comparable(self, spoken: Spoken) -> Iterator[tuple[list[Fraction], Fraction]]:
        """Yield the lists of values to compare a number with, and the factor that converts the number to their unit."""
        if spoken.unit is None:
            yield self.of_any_unit, Fraction(1)
            return
        for unit, values in self.by_unit.items():
            factors = _scales(spoken.unit) if unit is None else (conversion(spoken.unit, unit),)
            yield from ((values, factor) for factor in factors if factor is not None)


def _scales(unit: Unit | None) -> tuple[Fraction, ...]:
    """Return the factors by which a number in the text may be multiplied: 1, and that from its unit to coherent SI."""
    return (Fraction(1),) if unit is None else (Fraction(1), unit.scale * unit.angle_scale)


def _holds(values: Sequence[Fraction], wanted: Fraction, margin: Fraction) -> bool:
    """Whether one of the sorted values lies within the margin around the wanted value."""
    nearest = bisect.bisect_left(values, wanted - margin)
    return nearest < len(values) and values[nearest] <= wanted + margin


def _support(spoken: Spoken, returned: Sequence[ReturnedValue]) -> tuple[Support, float] | None:
    """Return the latest returned value that agrees with a number, and that value in the number's unit."""
    bands: dict[Unit | None, _Band | None] = {}
    for found in reversed(returned):
        if found.unit not in bands:
            bands[found.unit] = _band(spoken, found.unit)
        band = bands[found.unit]
        if band is not None and band.holds(found.value):
            support = Support(turn=found.turn, exchange=found.exchange, path=found.path, value=found.value)
            return support, found.value / band.factor
    return None


class _Band(NamedTuple):
    """The values that agree with a number: those that round to it and have its sign."""

    stated: Fraction
    half_unit: Fraction
    low: float
    high: float
    """Slightly widened bounds, which reject most values without exact arithmetic."""
    factor: float
    """Factor from the written unit to that of the values."""
    is_magnitude: bool
    """Whether the text calls the number a magnitude, so that the sign of the value does not matter."""

    def holds(self, value: float) -> bool:
        value = abs(value) if self.is_magnitude else value
        if not self.low <= value <= self.high:
            return False
        returned = exact(value)
        return abs(self.stated - returned) <= self.half_unit and self.stated * returned >= 0


def _band(spoken: Spoken, unit: Unit | None) -> _Band | None:
    """Return the values in a unit that agree with a number; None if the number has an incompatible unit.

    A number without a unit is compared as written. A number with a unit is converted to the unit of the returned
    value, or to coherent SI if that unit is unknown.
    """
    factor = Fraction(1)
    if spoken.unit is not None:
        converted = spoken.si_factor if unit is None else conversion(spoken.unit, unit)
        if converted is None:
            return None
        factor = converted
    stated, half_unit = spoken.value * factor, spoken.half_unit * factor
    low, high = float(stated - 2 * half_unit), float(stated + 2 * half_unit)
    return _Band(stated, half_unit, low, high, float(factor), spoken.is_magnitude)
