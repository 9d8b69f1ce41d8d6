"""Presents arguments, results and schemas of the tools in centimetres, milliseconds and grams in place of SI units.

Each quantity has one conversion factor: a velocity of 1 m/s is 0.1 cm/ms. Numbers are rounded to twelve digits, so that
0.3 m is 30 cm and not 30.000000000000004 cm.
"""

import re
from collections.abc import Mapping
from typing import Any

from pydantic import JsonValue

UNITS: dict[str, tuple[str, float]] = {
    "m": ("cm", 1e2),
    "s": ("ms", 1e3),
    "kg": ("g", 1e3),
    "m/s": ("cm/ms", 1e-1),
    "m/s²": ("cm/ms²", 1e-4),
    "rad/s": ("rad/ms", 1e-3),
    "N": ("g·cm/ms²", 1e-1),
    "N·m": ("g·cm²/ms²", 1e1),
    "J": ("g·cm²/ms²", 1e1),
    "N·s": ("g·cm/ms", 1e2),
    "kg·m/s": ("g·cm/ms", 1e2),
    "kg·m²/s": ("g·cm²/ms", 1e4),
    "kg/m³": ("g/cm³", 1e-3),
}
"""SI unit → the unit that replaces it, and the conversion factor."""

FIELDS: dict[str, str] = {
    **dict.fromkeys(("duration", "sim_time", "lab_time_left"), "s"),
    **dict.fromkeys(("dx", "dy", "dz", "pos", "radius", "size", "position", "new_position", "bounding_box"), "m"),
    **dict.fromkeys(("displacement", "contact_point", "center_of_mass"), "m"),
    **dict.fromkeys(("velocity_vector", "velocity", "approach_speed"), "m/s"),
    **dict.fromkeys(("mass",), "kg"),
    **dict.fromkeys(("density",), "kg/m³"),
    **dict.fromkeys(("force_vector", "force"), "N"),
    **dict.fromkeys(("torque_vector", "torque"), "N·m"),
    **dict.fromkeys(("kinetic_energy", "potential_energy", "rotational_energy"), "J"),
    "gravity": "m/s²",
    "angular_velocity": "rad/s",
    "momentum": "kg·m/s",
    "angular_momentum": "kg·m²/s",
    "impulse": "N·s",
}
"""Argument or field of a result → its SI unit. Arguments and fields that are not listed are not converted."""

COMPONENTS = {"move_object": "m", "get_acceleration": "m/s²", "compute_force": "N"}
"""Tool → unit of its arguments or fields x, y and z."""

SENTENCES = (
    (
        "SI units. World frame, z up.",
        "The text of the task, the limits in it and error messages are in SI units. The tools are not: their arguments"
        " and results are in centimetres, milliseconds and grams, so velocities are in cm/ms, accelerations in cm/ms²,"
        " forces in g·cm/ms², torques and energies in g·cm²/ms², and densities in g/cm³. Answer in the unit that the"
        " task names. World frame, z up.",
    ),
    (
        "of time, places, velocities and what you apply, in SI units. It is graded apart,",
        "of time, places, velocities and what you apply. The law is in SI units, unlike all other arguments of the"
        " tools: convert your readings to metres, seconds, kilograms and newtons before you state it. It is graded"
        " apart,",
    ),
)
"""Sentences of the opening prompt about units, each with its replacement. The second occurs only in scenes that ask for
a law.
"""

LAW_UNITS = (
    "the acceleration of each object in SI units,",
    "the acceleration of each object in SI units (metres, seconds, kilograms, newtons), unlike all other arguments of"
    " the tools,",
)
"""Words in the description of the argument `law`, whose units are not converted, and the words that replace them."""

_BOUNDS = frozenset({"minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum", "default"})
_BRACKETS = re.compile(r"\[([^\]\s]+)\]")
_DIGITS = 12


def unit_of(tool: str, name: str) -> str | None:
    """Return the SI unit of an argument or a field of a result; None if it is not converted."""
    return COMPONENTS.get(tool) if name in {"x", "y", "z"} else FIELDS.get(name)


def exchanged(tool: str, members: Mapping[str, JsonValue], *, inverse: bool) -> dict[str, JsonValue]:
    """Convert the numbers in arguments or in a result.

    Args:
        tool: Name of the tool.
        members: The arguments, or the fields of the result.
        inverse: Whether to convert back to SI units.
    """

    def member(name: str, value: JsonValue) -> JsonValue:
        unit = unit_of(tool, name)
        if unit is not None:
            return _scaled(value, UNITS[unit][1], inverse=inverse)
        if isinstance(value, list):  # the objects that `find_objects` reveals
            return [exchanged(tool, one, inverse=inverse) if isinstance(one, dict) else one for one in value]
        return value

    return {name: member(name, value) for name, value in members.items()}


def _scaled(value: JsonValue, factor: float, *, inverse: bool) -> JsonValue:
    if isinstance(value, bool) or value is None or isinstance(value, str):
        return value
    if isinstance(value, list):
        return [_scaled(part, factor, inverse=inverse) for part in value]
    if isinstance(value, dict):
        return {name: _scaled(part, factor, inverse=inverse) for name, part in value.items()}
    try:
        return float(f"{value / factor if inverse else value * factor:.{_DIGITS}g}")
    except OverflowError:  # an integer beyond the range of floats, which the laboratory refuses
        return value


def exchanged_schema(tool: str, schema: Mapping[str, Any], *, inverse: bool) -> dict[str, Any]:
    """Convert the bounds of arguments in a schema, and the units in their descriptions."""

    def arguments(properties: Mapping[str, Any]) -> dict[str, Any]:
        return {name: part(described, unit_of(tool, name)) for name, described in properties.items()}

    def part(value: JsonValue, unit: str | None) -> JsonValue:
        if isinstance(value, dict):
            found: dict[str, JsonValue] = {}
            for name, inner in value.items():
                if name in _BOUNDS and unit is not None:
                    found[name] = _scaled(inner, UNITS[unit][1], inverse=inverse)
                elif name == "description" and isinstance(inner, str):
                    found[name] = described_units(inner, inverse=inverse)
                else:
                    found[name] = part(inner, unit)
            return found
        return [part(inner, unit) for inner in value] if isinstance(value, list) else value

    return {name: arguments(value) if name == "properties" else part(value, None) for name, value in schema.items()}


def described_units(text: str, *, inverse: bool) -> str:
    """Replace the units in square brackets in a description, and the words about the units of a law."""
    before, after = reversed(LAW_UNITS) if inverse else LAW_UNITS
    text = text.replace(before, after)
    table = {other: unit for unit, (other, _) in UNITS.items()} if inverse else {u: o for u, (o, _) in UNITS.items()}
    return _BRACKETS.sub(lambda found: f"[{table.get(found[1], found[1])}]", text)
