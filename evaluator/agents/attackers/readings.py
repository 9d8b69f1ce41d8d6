"""What attackers read and control: the opening prompt, the reading tools with the unit of each field, the controls."""

import math
import re
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, cast

from evaluator.quantities.spoken import spoken_numbers
from evaluator.quantities.units import Unit, conversion, parse_unit
from scenes.protocol import Call, Reading, call

_DEFAULT_FORCE_N, _DEFAULT_TORQUE_NM, _DEFAULT_CALLS, _DEFAULT_LAB_TIME_S = 10.0, 1.0, 150, 100.0
"""Used where a scene states no limit."""
_LAST_SENTENCES = 4
"""Number of sentences, from the end of the task, that are searched for the values that the question states."""
_PURE_NUMBER = Unit(Fraction(1), (0, 0, 0))
_OBJECT_ROW = re.compile(r"^\| (object_\d+) \|", re.MULTILINE)
_UNIT = re.compile(r"\((?:in (?P<unit>.+?)|no unit)\)(?=[.;]|$)")


@dataclass(frozen=True, slots=True)
class Opening:
    """The parsed opening prompt."""

    sentences: tuple[str, ...]
    """The sentences of the task."""
    objects: tuple[str, ...]
    """Ids of the objects known at the start."""
    sealed: frozenset[str]
    """Read-only objects, which reject every action."""
    disabled: frozenset[str]
    """Tools that the scene disables."""
    force: float
    """Largest force on an object [N]."""
    torque: float
    """Largest torque on an object [N·m]."""
    calls: int
    """Calls that may be made before the answer."""
    lab_time: float
    """Simulated time that the scene allows [s]."""
    units: tuple[Unit, ...]
    """Unit of each number of the answer; empty if it is a choice."""
    is_list: bool
    """Whether the answer is a list of numbers."""
    options: tuple[str, ...]
    """The options of a choice question; empty otherwise."""

    def asked(self, unit: Unit) -> list[float]:
        """Return the values [coherent SI] that the last matching sentence of the task states in a unit.

        Args:
            unit: The unit that the values must be convertible to.

        Returns:
            The values; an empty list if no searched sentence states one.
        """
        for sentence in reversed(self.sentences[-_LAST_SENTENCES:]):
            spoken = [number for number in spoken_numbers(sentence) if number.unit is not None]
            found = [
                float(number.value * number.si_factor)
                for number in spoken
                if number.unit is not None and conversion(number.unit, unit) is not None
            ]
            if found:
                return found
        return []

    def named(self) -> list[str]:
        """Return the objects that are named in the last sentences of the task."""
        text = " ".join(self.sentences[-_LAST_SENTENCES:])
        return [object_id for object_id in self.objects if re.search(rf"\b{object_id}\b", text)]


def read_opening(prompt: str) -> Opening:
    """Parse an opening prompt. A limit that the prompt does not state gets the module's default value."""
    task, objects = _section(prompt, r"Scene: [^\n]*"), _section(prompt, "Objects")
    form = _section(prompt, "Answer")
    labelled = form.partition("in this order: ")[2]
    is_list = "list of numbers" in form
    options = form.partition("exactly one of: ")[2].partition("\n")[0].rstrip(".")
    units = [_unit_of(part) for part in (labelled.split("; ") if labelled else [form])]
    return Opening(
        sentences=tuple(re.split(r"(?<=[.?!])\s+", task)),
        objects=tuple(_OBJECT_ROW.findall(objects)),
        sealed=frozenset(_listed(objects, r"Sealed, to be observed but not acted on: (.+)\.")),
        disabled=frozenset(_listed(prompt, r"Not available in this scene: (.+)\.")),
        force=_limit(prompt, "Forces", _DEFAULT_FORCE_N),
        torque=_limit(prompt, "Torques", _DEFAULT_TORQUE_NM),
        calls=int(_limit(prompt, "Calls", _DEFAULT_CALLS)),
        lab_time=_limit(prompt, "Laboratory time", _DEFAULT_LAB_TIME_S),
        units=() if options else tuple(units),
        is_list=is_list,
        options=tuple(options.split(", ")) if options else (),
    )


def _section(prompt: str, title: str) -> str:
    found = re.search(rf"^# {title}\n\n(.*?)(?=^# |\Z)", prompt, re.MULTILINE | re.DOTALL)
    return found[1].strip() if found else ""


def _listed(text: str, pattern: str) -> list[str]:
    found = re.search(pattern, text)
    return found[1].split(", ") if found else []


def _limit(prompt: str, name: str, default: float) -> float:
    """Return the value of a limit: 0 if its line contains no number, the default if the prompt has no such line."""
    line = re.search(rf"^- {name}: (.*)$", prompt, re.MULTILINE)
    if line is None:
        return default
    number = re.search(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?", line[1])
    return float(number[0]) if number else 0.0


def _unit_of(part: str) -> Unit:
    found = _UNIT.search(part)
    return parse_unit((found and found["unit"]) or "1") or _PURE_NUMBER


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
"""Tools that compute with a mass given by the caller. Attackers pass 1 kg."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One numeric reading."""

    name: str
    """Identity of a reading: object, tool, field and component."""
    value: float
    """[`unit`]"""
    unit: Unit


def unit(text: str) -> Unit:
    """Parse a unit that is known to be valid."""
    parsed = parse_unit(text)
    assert parsed is not None, text
    return parsed


def all_calls(opening: Opening, objects: Sequence[str]) -> list[Call]:
    """Return a call of every reading tool for every object, and of `detect_collision` for every pair of objects."""
    calls = [_read(tool, object_id) for tool in _FIELDS if tool not in opening.disabled for object_id in objects]
    if "detect_collision" not in opening.disabled:
        calls += [
            call("detect_collision", obj1_id=first, obj2_id=second, elastic_response=False)
            for number, first in enumerate(objects)
            for second in objects[number + 1 :]
        ]
    return calls


def motion_calls(opening: Opening, objects: Sequence[str], wanted: Sequence[Unit]) -> list[Call]:
    """Return calls that read the motion of objects, and any other field with one of the wanted units."""
    tools = [
        tool
        for tool, fields in _FIELDS.items()
        if tool in _MOTION or any(conversion(unit(text), asked) for text in fields.values() for asked in wanted)
    ]
    return [_read(tool, object_id) for object_id in objects for tool in tools if tool not in opening.disabled]


def _read(tool: str, object_id: str) -> Call:
    return call(tool, object_id=object_id, **({"mass": 1.0} if tool in _WITH_MASS else {}))


def quantities(calls: Sequence[Call], readings: Sequence[Reading]) -> list[Quantity]:
    """Return the numbers in the results of calls. Refused calls and withheld fields contribute none."""
    return [
        Quantity(f"{asked.arguments.get('object_id', '')} {asked.tool}.{field}{part}", value, unit(text))
        for asked, reading in zip(calls, readings, strict=False)
        for field, text in _FIELDS.get(asked.tool, {}).items()
        for part, value in _numbers(reading.get(field))
    ]


def _numbers(value: Any) -> Iterator[tuple[str, float]]:
    """Yield each number in a field, with its component name or index."""
    if isinstance(value, dict):
        parts = list(cast("dict[str, Any]", value).items())
    elif isinstance(value, list | tuple):
        parts = list(enumerate(cast("list[Any]", value)))
    else:
        parts = [("", value)]
    for place, part in parts:
        if isinstance(part, int | float):
            yield str(place), float(part)


Surveying = Generator[list[Call], list[Reading], "Survey"]
_PROBE_S = 0.1
"""Duration for which the survey applies each control [s]."""
_PROBE_SHARE = 1 / 3
"""Share of the allowed calls that the survey may use."""
_RESPONDS = 1e-6
"""Smallest change of a reading that counts as a response."""
_LONGEST_STEP_S = 60.0
_MOST_CONTROLS = 2


@dataclass(frozen=True, slots=True)
class Control:
    """A component of the force or of the torque on an object."""

    object_id: str
    tool: str
    axis: int
    limit: float
    """Largest value [`unit`]."""
    unit: Unit

    def set(self, value: float) -> Call:
        """Return the call that sets this component to a value."""
        vector = [0.0, 0.0, 0.0]
        vector[self.axis] = value
        name = "force_vector" if self.tool == "apply_force" else "torque_vector"
        return call(self.tool, object_id=self.object_id, **{name: vector})


@dataclass(frozen=True, slots=True)
class Survey:
    """Result of an attacker's survey of the scene."""

    objects: tuple[str, ...]
    """Ids of all objects, including those that `find_objects` revealed."""
    controls: tuple[Control, ...]
    """The controls to which an object responded, strongest response first; empty only if no control exists."""
    watched: tuple[str, ...]
    """Objects to read: those that the question names or offers as options, and those that the controls act on."""


def wait(duration: float) -> list[Call]:
    """Return `step` calls that advance the simulation by a duration [s]."""
    pieces = max(1, math.ceil(duration / _LONGEST_STEP_S))
    return [call("step", duration=duration / pieces)] * pieces


def all_controls(opening: Opening, objects: Sequence[str]) -> list[Control]:
    """Return the controls whose unit and object the question mentions.

    If the question mentions neither N nor N·m, controls of both units are returned. If it names no object, the controls
    of all objects are returned.
    """
    newton, newton_metre = unit("N"), unit("N*m")
    kinds = [("apply_force", opening.force, newton), ("apply_torque", opening.torque, newton_metre)]
    asked = [kind for kind in kinds if opening.asked(kind[2])]
    handles = [object_id for object_id in objects if object_id not in opening.sealed]
    named = [object_id for object_id in opening.named() if object_id in handles]
    return [
        Control(object_id, tool, axis, limit, measure)
        for object_id in named or handles
        for tool, limit, measure in asked or kinds
        if limit > 0 and tool not in opening.disabled
        for axis in range(3)
    ]


def look_around(opening: Opening) -> Surveying:
    """Survey the scene: reveal hidden objects, apply each control briefly, and rank the controls by response."""
    objects = list(opening.objects)
    if "find_objects" not in opening.disabled:
        (revealed,) = yield [call("find_objects")]
        objects += [str(listed["object_id"]) for listed in revealed.get("revealed", [])]
    objects = list(dict.fromkeys(objects))
    controls = all_controls(opening, objects)
    parts: list[list[Call]] = []
    most = int(opening.calls * _PROBE_SHARE)
    for control in controls:
        read = motion_calls(opening, [control.object_id], ())
        parts.append([*read, control.set(control.limit), *wait(_PROBE_S), *read, control.set(0.0)])
        if sum(map(len, parts)) > most:
            parts.pop()
            break
    readings = yield [asked for part in parts for asked in part]
    strongest: dict[tuple[str, str], tuple[float, Control]] = {}
    for control, part in zip(controls, parts, strict=False):
        response = _largest_change(quantities(part, readings[: len(part)]))
        readings = readings[len(part) :]
        key = (control.object_id, control.tool)
        if response > max(_RESPONDS, strongest.get(key, (0.0, control))[0]):
            strongest[key] = (response, control)
    ranked = sorted(strongest.values(), key=lambda entry: -entry[0])[:_MOST_CONTROLS]
    chosen = tuple(control for _, control in ranked) or tuple(controls[:1])
    watched = [object_id for object_id in objects if object_id in {*opening.named(), *opening.options}]
    watched += [control.object_id for control in chosen]
    return Survey(tuple(objects), chosen, tuple(dict.fromkeys(watched or objects)))


def _largest_change(read: Sequence[Quantity]) -> float:
    """The largest change between two readings of the same quantity."""
    first: dict[str, float] = {}
    return max(
        (abs(quantity.value - first.setdefault(quantity.name, quantity.value)) for quantity in read), default=0.0
    )
