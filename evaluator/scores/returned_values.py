"""The numbers that tool calls carry and return, with their units. Judges nothing."""

import math
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any, NamedTuple

from evaluator.quantities.units import Unit, parse_unit
from evaluator.records.episode import Exchange

FIELD_UNITS: Mapping[str, str] = {
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
    "torque": "N·m",
    "mass": "kg",
    "density": "kg/m³",
    "kinetic_energy": "J",
    "potential_energy": "J",
    "rotational_energy": "J",
    "momentum": "kg·m/s",
    "angular_momentum": "kg·m²/s",
    "impulse": "N·s",
    "orientation": "1",
    "normal": "1",
    "rotation_matrix": "1",
    "angle": "rad",
    "angular_velocity": "rad/s",
    "steps": "1",
    "lab_time_left": "s",
    "calls_left": "1",
}
"""Units of result fields, from the tools' contract. A field that is not listed matches a number in any unit."""
COMPONENT_UNITS: Mapping[str, str] = {"get_acceleration": "m/s²", "compute_force": "N"}
"""Units of the tools that return bare `x`, `y` and `z`."""
_FIELDS, _COMPONENTS = (
    {name: parse_unit(unit) for name, unit in units.items()} for units in (FIELD_UNITS, COMPONENT_UNITS)
)


class ReturnedValue(NamedTuple):
    """A number that a call returned."""

    value: float
    unit: Unit | None
    """None if the tools' contract does not tell the unit."""
    turn: int
    """Index of the turn, from 0."""
    exchange: int
    """Index of the exchange within the turn, from 0."""
    path: str
    """JSON path in the returned content, such as `$.velocity[2]`."""


def returned_values(exchange: Exchange, turn: int, position: int) -> Iterator[ReturnedValue]:
    """The numbers that a call returned; none if it was refused or not run."""
    if not exchange.returned or exchange.is_error or exchange.content is None:
        return
    for path, value in numbers_in(exchange.content):
        name = path.removeprefix("$.").partition(".")[0].partition("[")[0]
        unit = _COMPONENTS.get(exchange.call.tool) if name in {"x", "y", "z"} else _FIELDS.get(name)
        yield ReturnedValue(value, unit, turn, position, path)


def numbers_in(value: Any, path: str = "$") -> Iterator[tuple[str, float]]:
    """The numbers inside a JSON value, however deep, in order, each with its JSON path."""
    if isinstance(value, dict):
        for name, inner in value.items():  # pyright: ignore[reportUnknownVariableType] - JSON
            yield from numbers_in(inner, f"{path}.{name}")
    elif isinstance(value, (list, tuple)):
        for index, inner in enumerate(value):  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON
            yield from numbers_in(inner, f"{path}[{index}]")
    elif isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) < 1e300:
        yield path, float(value)


def exact(value: float) -> Fraction:
    """The number as it is written; 0 if it is not finite."""
    return Fraction(repr(value)) if math.isfinite(value) else Fraction(0)
