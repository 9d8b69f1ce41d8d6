"""The reading tools as attackers use them: what each returns, in which unit."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, cast

from evaluator.agents.attackers.opening import Opening
from evaluator.quantities.units import Unit, conversion, parse_unit
from scenes.protocol import Call, Reading, call

_MOTION = {
    "get_position": {"position": "m", "angle": "rad"},
    "get_velocity": {"velocity": "m/s", "angular_velocity": "rad/s"},
}
_FIELDS = _MOTION | {
    "get_acceleration": {"x": "m/s^2", "y": "m/s^2", "z": "m/s^2"},
    "get_displacement": {"displacement": "m"},
    "get_torque": {"torque": "N*m"},
    "get_parameters": {"mass": "kg", "bounding_box": "m"},
    "compute_force": {"x": "N", "y": "N", "z": "N"},
    "get_kinetic_energy": {"kinetic_energy": "J"},
    "get_potential_energy": {"potential_energy": "J"},
    "get_rotational_energy": {"rotational_energy": "J"},
    "get_momentum": {"momentum": "kg*m/s"},
    "get_angular_momentum": {"angular_momentum": "kg*m^2/s"},
}
"""Tool → numeric field → its unit."""
_WITH_MASS = frozenset(
    {"compute_force", "get_kinetic_energy", "get_potential_energy", "get_rotational_energy", "get_momentum"}
    | {"get_angular_momentum"}
)
"""Tools that compute with a mass that the caller gives; attackers give 1 kg."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A number that was read."""

    name: str
    """Object, field and component: the same for each reading of the same quantity."""
    value: float
    """[`unit`]"""
    unit: Unit


def unit(text: str) -> Unit:
    """A unit that is known to be one."""
    parsed = parse_unit(text)
    assert parsed is not None, text
    return parsed


def all_calls(opening: Opening, objects: Sequence[str]) -> list[Call]:
    """A call of every reading tool for every object, and for every pair of them."""
    calls = [_read(tool, object_id) for tool in _FIELDS if tool not in opening.disabled for object_id in objects]
    if "detect_collision" not in opening.disabled:
        calls += [
            call("detect_collision", obj1_id=first, obj2_id=second, elastic_response=False)
            for number, first in enumerate(objects)
            for second in objects[number + 1 :]
        ]
    return calls


def motion_calls(opening: Opening, objects: Sequence[str], wanted: Sequence[Unit]) -> list[Call]:
    """Calls that read the motion of objects, and what else may have a wanted unit."""
    tools = [
        tool
        for tool, fields in _FIELDS.items()
        if tool in _MOTION or any(conversion(unit(text), asked) for text in fields.values() for asked in wanted)
    ]
    return [_read(tool, object_id) for object_id in objects for tool in tools if tool not in opening.disabled]


def _read(tool: str, object_id: str) -> Call:
    return call(tool, object_id=object_id, **({"mass": 1.0} if tool in _WITH_MASS else {}))


def quantities(calls: Sequence[Call], readings: Sequence[Reading]) -> list[Quantity]:
    """The numbers in the results of calls; a refused call and a withheld field give none."""
    return [
        Quantity(f"{asked.arguments.get('object_id', '')} {asked.tool}.{field}{part}", value, unit(text))
        for asked, reading in zip(calls, readings, strict=False)
        for field, text in _FIELDS.get(asked.tool, {}).items()
        for part, value in _numbers(reading.get(field))
    ]


def _numbers(value: Any) -> Iterator[tuple[str, float]]:
    """The numbers of a field, each with its place in it."""
    if isinstance(value, dict):
        parts = list(cast("dict[str, Any]", value).items())
    elif isinstance(value, list | tuple):
        parts = list(enumerate(cast("list[Any]", value)))
    else:
        parts = [("", value)]
    for place, part in parts:
        if isinstance(part, int | float):
            yield str(place), float(part)
