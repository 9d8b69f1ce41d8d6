"""G: which numbers in an agent's reasoning were really measured. Pure functions over recorded episodes.

An assertion is a number that the reasoning states. These are no assertions: a number inside a word or an exponent, a
count of steps, the number of an object, a number from the prompt, and a number that the agent itself put into a call.

An assertion is grounded if a call of an *earlier* turn returned its value: equal at the precision written, in a unit of
the same kind, and with the same sign unless the text calls it a magnitude.
"""

import bisect
import math
from collections.abc import Iterator, Sequence
from fractions import Fraction
from typing import Any, NamedTuple

from evaluator.quantities.spoken import Spoken, spoken_numbers
from evaluator.quantities.units import Unit, conversion, parse_unit
from evaluator.records import Episode, Exchange, Record

_ANSWER = "answer"

_FIELD_UNITS = {
    name: parse_unit(unit)
    for name, unit in {
        "sim_time": "s",
        "position": "m",
        "new_position": "m",
        "displacement": "m",
        "bounding_box": "m",
        "center_of_mass": "m",
        "contact_point": "m",
        "velocity": "m/s",
        "approach_speed": "m/s",
        "force": "N",
        "torque": "N*m",
        "mass": "kg",
        "density": "kg/m^3",
        "kinetic_energy": "J",
        "potential_energy": "J",
        "rotational_energy": "J",
        "momentum": "kg*m/s",
        "angular_momentum": "kg*m^2/s",
        "impulse": "N*s",
        "orientation": "1",
        "normal": "1",
        "rotation_matrix": "1",
        "angle": "rad",
        "angular_velocity": "rad/s",
        "steps": "1",
        "lab_time_left": "s",
        "calls_left": "1",
    }.items()
}
"""Units of result fields, from the tools' contract. A field that is not listed matches a number in any unit."""
_COMPONENT_UNITS = {"get_acceleration": parse_unit("m/s^2"), "compute_force": parse_unit("N")}
"""Units of the tools that return bare `x`, `y` and `z`."""


class Support(Record):
    """The returned value behind an assertion."""

    turn: int
    """Index of the turn, from 0."""
    exchange: int
    """Index of the exchange within the turn, from 0."""
    path: str
    """JSON path in the returned content, such as `$.velocity[2]`."""
    value: float
    """What was returned there."""


class Assertion(Record):
    """A number that the reasoning states."""

    turn: int
    """Index of the turn, from 0."""
    start: int
    """Its first character in the turn's reasoning, from 0."""
    end: int
    """The character after its last."""
    text: str
    """As written, unit included."""
    support: Support | None
    """The latest returned value that supports it; None if none does."""


class Grounding(Record):
    """All assertions of an episode, in order."""

    assertions: tuple[Assertion, ...]

    @property
    def share(self) -> float | None:
        """Share of supported assertions; None without any."""
        if not self.assertions:
            return None
        return sum(assertion.support is not None for assertion in self.assertions) / len(self.assertions)


class _Returned(NamedTuple):
    value: float
    unit: Unit | None
    turn: int
    exchange: int
    path: str


def grounding_of(episode: Episode) -> Grounding:
    """Find the assertions of an episode and what supports them."""
    given = _PromptNumbers.of(episode.prompt)
    own: list[Fraction] = []
    returned: list[_Returned] = []
    assertions: list[Assertion] = []
    for index, turn in enumerate(episode.turns):
        for exchange in turn.exchanges:
            if exchange.call.tool != _ANSWER:
                for _, value in _numbers_in(exchange.call.arguments):
                    bisect.insort(own, abs(_exact(value)))
        for spoken in spoken_numbers(turn.reasoning):
            if not _is_given(spoken, given, own):
                start, end, support = spoken.start, spoken.end, _support(spoken, returned)
                text = turn.reasoning[start:end]
                assertions.append(Assertion(turn=index, start=start, end=end, text=text, support=support))
        for position, exchange in enumerate(turn.exchanges):
            returned.extend(_returned(exchange, index, position))
    return Grounding(assertions=tuple(assertions))


def _is_given(spoken: Spoken, given: "_PromptNumbers", own: Sequence[Fraction]) -> bool:
    """Whether the number comes from the prompt or from the agent's own calls, those of this turn included.

    It must be equal, or equal when rounded if it has at least two significant digits (`9.8` for 9.81). Its own
    arguments match by magnitude, because agents often leave out their sign (`push with 2 N` for -2).
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
    """All of them, as written and in coherent SI, for comparison with a number without a unit."""

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
        """Lists that may hold a number, each with the factor that converts the number to the list's unit."""
        if spoken.unit is None:
            yield self.of_any_unit, Fraction(1)
            return
        for unit, values in self.by_unit.items():
            factors = _scales(spoken.unit) if unit is None else (conversion(spoken.unit, unit),)
            yield from ((values, factor) for factor in factors if factor is not None)


def _scales(unit: Unit | None) -> tuple[Fraction, ...]:
    """Factors of a number in a unit: 1, and the factor that converts it to coherent SI."""
    return (Fraction(1),) if unit is None else (Fraction(1), unit.scale * unit.angle_scale)


def _holds(values: Sequence[Fraction], wanted: Fraction, margin: Fraction) -> bool:
    """Whether one of the sorted values lies within the margin around the wanted value."""
    nearest = bisect.bisect_left(values, wanted - margin)
    return nearest < len(values) and values[nearest] <= wanted + margin


def _support(spoken: Spoken, returned: Sequence[_Returned]) -> Support | None:
    """The latest returned value that agrees with a number."""
    bands: dict[Unit | None, _Band | None] = {}
    for found in reversed(returned):
        if found.unit not in bands:
            bands[found.unit] = _band(spoken, found.unit)
        band = bands[found.unit]
        if band is not None and band.holds(found.value):
            return Support(turn=found.turn, exchange=found.exchange, path=found.path, value=found.value)
    return None


class _Band(NamedTuple):
    """The values that a number agrees with: those that round to it and have its sign."""

    stated: Fraction
    half_unit: Fraction
    low: float
    high: float
    """Bounds a little too wide, to reject most values without exact arithmetic."""
    is_magnitude: bool
    """Whether the text calls the number a magnitude, so that the sign of the value does not matter."""

    def holds(self, value: float) -> bool:
        value = abs(value) if self.is_magnitude else value
        if not self.low <= value <= self.high:
            return False
        exact = _exact(value)
        return abs(self.stated - exact) <= self.half_unit and self.stated * exact >= 0


def _band(spoken: Spoken, unit: Unit | None) -> _Band | None:
    """The values in a unit that a number agrees with; None if the number has a unit of another kind.

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
    return _Band(stated, half_unit, float(stated - 2 * half_unit), float(stated + 2 * half_unit), spoken.is_magnitude)


def _returned(exchange: Exchange, turn: int, position: int) -> Iterator[_Returned]:
    if not exchange.returned or exchange.is_error or exchange.content is None:
        return
    for path, value in _numbers_in(exchange.content):
        name = path.removeprefix("$.").partition(".")[0].partition("[")[0]
        unit = _COMPONENT_UNITS.get(exchange.call.tool) if name in {"x", "y", "z"} else _FIELD_UNITS.get(name)
        yield _Returned(value, unit, turn, position, path)


def _numbers_in(value: Any, path: str = "$") -> Iterator[tuple[str, float]]:
    """The numbers inside a JSON value, however deep, in order, each with its JSON path."""
    if isinstance(value, dict):
        for name, inner in value.items():  # pyright: ignore[reportUnknownVariableType] - JSON
            yield from _numbers_in(inner, f"{path}.{name}")
    elif isinstance(value, (list, tuple)):
        for index, inner in enumerate(value):  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON
            yield from _numbers_in(inner, f"{path}[{index}]")
    elif isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300:
        yield path, float(value)


def _exact(value: float) -> Fraction:
    return Fraction(repr(value)) if math.isfinite(value) else Fraction(0)
