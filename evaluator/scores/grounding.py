"""G: which numbers of an agent's reasoning were really measured. Pure functions over recorded episodes.

An assertion is a number that the reasoning states: not one inside a word or an exponent, not a count of steps or the
number of an object, not one that the prompt gave, and not one that the agent itself put into a call. It is grounded if
a call of an *earlier* turn returned it, to the precision written, with the same sign unless it is told to be a
magnitude, in a unit of the same kind.
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
        "steps": "1",
    }.items()
}
"""Units of result fields, from the tools' contract. A field that is not listed is compared without regard to units."""
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
    """Where it stands in the turn's reasoning, in characters."""
    end: int
    text: str
    """As written, unit included."""
    support: Support | None
    """The latest return that supports it, or None."""


class Grounding(Record):
    """All assertions of an episode, in order."""

    assertions: tuple[Assertion, ...]

    @property
    def share(self) -> float | None:
        """Share of supported assertions; None without any."""
        if not self.assertions:
            return None
        return sum(one.support is not None for one in self.assertions) / len(self.assertions)


class _Returned(NamedTuple):
    value: float
    unit: Unit | None
    turn: int
    exchange: int
    path: str


def grounding_of(episode: Episode) -> Grounding:
    """Find the assertions of an episode and what supports them."""
    told = _Told.by(episode.prompt)
    own: list[Fraction] = []
    returned: list[_Returned] = []
    assertions: list[Assertion] = []
    for index, turn in enumerate(episode.turns):
        for exchange in turn.exchanges:
            if exchange.call.tool != _ANSWER:
                for _, value in _numbers_in(exchange.call.arguments):
                    bisect.insort(own, abs(_exact(value)))
        for spoken in spoken_numbers(turn.reasoning):
            if not _is_given(spoken, told, own):
                start, end, support = spoken.start, spoken.end, _support(spoken, returned)
                text = turn.reasoning[start:end]
                assertions.append(Assertion(turn=index, start=start, end=end, text=text, support=support))
        for position, exchange in enumerate(turn.exchanges):
            returned.extend(_returned(exchange, index, position))
    return Grounding(assertions=tuple(assertions))


def _is_given(spoken: Spoken, told: "_Told", own: Sequence[Fraction]) -> bool:
    """Tell whether the prompt or the agent's own calls, this turn's included, hold the number.

    Exactly, or rounded to what is written if that is two significant digits or more (`9.8` for 9.81). Of its own
    arguments an agent often gives the size alone (`push with 2 N` for -2), so these go by size.
    """
    half_unit = spoken.half_unit if spoken.significant_digits > 1 else Fraction(0)
    size = abs(spoken.value)
    return any(
        _holds(values, spoken.value * factor, half_unit * factor) for values, factor in told.comparable(spoken)
    ) or any(_holds(own, size * factor, half_unit * factor) for factor in (Fraction(1), spoken.si_factor))


class _Told(NamedTuple):
    """The numbers of a prompt, sorted."""

    by_unit: dict[Unit | None, list[Fraction]]
    of_any_unit: list[Fraction]
    """All of them, as written and in coherent SI: what a number without a unit may repeat."""

    @classmethod
    def by(cls, prompt: str) -> "_Told":
        by_unit: dict[Unit | None, list[Fraction]] = {None: []}
        for one in spoken_numbers(prompt):
            bisect.insort(by_unit.setdefault(one.unit, []), one.value)
        everything = {
            value * factor for unit, values in by_unit.items() for value in values for factor in _scales(unit)
        }
        return cls(by_unit, sorted(everything))

    def comparable(self, spoken: Spoken) -> Iterator[tuple[list[Fraction], Fraction]]:
        """Lists that may hold a number, each with the factor to its unit."""
        if spoken.unit is None:
            yield self.of_any_unit, Fraction(1)
            return
        for unit, values in self.by_unit.items():
            factors = _scales(spoken.unit) if unit is None else (conversion(spoken.unit, unit),)
            yield from ((values, factor) for factor in factors if factor is not None)


def _scales(unit: Unit | None) -> tuple[Fraction, ...]:
    """Factors that leave a number as written, and that bring it to coherent SI."""
    return (Fraction(1),) if unit is None else (Fraction(1), unit.scale * unit.angle_scale)


def _holds(values: Sequence[Fraction], wanted: Fraction, margin: Fraction) -> bool:
    """Tell whether one of the sorted values lies within the margin."""
    nearest = bisect.bisect_left(values, wanted - margin)
    return nearest < len(values) and values[nearest] <= wanted + margin


def _support(spoken: Spoken, returned: Sequence[_Returned]) -> Support | None:
    """The latest return that agrees with a number."""
    bands: dict[Unit | None, _Band | None] = {}
    for one in reversed(returned):
        if one.unit not in bands:
            bands[one.unit] = _band(spoken, one.unit)
        band = bands[one.unit]
        if band is not None and band.holds(one.value):
            return Support(turn=one.turn, exchange=one.exchange, path=one.path, value=one.value)
    return None


class _Band(NamedTuple):
    """The values that a number agrees with: those that round to it, with its sign."""

    said: Fraction
    half_unit: Fraction
    low: float
    high: float
    """Bounds a little too wide, to pass over the many values that are far off."""
    is_magnitude: bool
    """Whether the number is told to be a size, so that the sign of the value does not matter."""

    def holds(self, value: float) -> bool:
        value = abs(value) if self.is_magnitude else value
        if not self.low <= value <= self.high:
            return False
        exact = _exact(value)
        return abs(self.said - exact) <= self.half_unit and self.said * exact >= 0


def _band(spoken: Spoken, unit: Unit | None) -> _Band | None:
    """What a number says in a unit; None where it speaks of something else.

    Without a unit a number is taken as it stands. A unit that is written counts: it is converted to the unit of the
    returned value, or to coherent SI where that is not known.
    """
    factor = Fraction(1)
    if spoken.unit is not None:
        converted = spoken.si_factor if unit is None else conversion(spoken.unit, unit)
        if converted is None:
            return None
        factor = converted
    said, half_unit = spoken.value * factor, spoken.half_unit * factor
    return _Band(said, half_unit, float(said - 2 * half_unit), float(said + 2 * half_unit), spoken.is_magnitude)


def _returned(exchange: Exchange, turn: int, position: int) -> Iterator[_Returned]:
    if not exchange.returned or exchange.is_error or exchange.content is None:
        return
    for path, value in _numbers_in(exchange.content):
        name = path.removeprefix("$.").partition(".")[0].partition("[")[0]
        unit = _COMPONENT_UNITS.get(exchange.call.tool) if name in {"x", "y", "z"} else _FIELD_UNITS.get(name)
        yield _Returned(value, unit, turn, position, path)


def _numbers_in(value: Any, path: str = "$") -> Iterator[tuple[str, float]]:
    """Numbers inside JSON, with their paths; arrays inside arrays inside objects, in order."""
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
