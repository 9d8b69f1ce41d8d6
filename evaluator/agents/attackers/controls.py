"""The controls of an attacker (force or torque along an axis) and the survey of which objects respond to them."""

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass

from evaluator.agents.attackers.readings import Opening, Quantity, motion_calls, quantities, unit
from evaluator.quantities.units import Unit
from scenes.protocol import Call, Reading, call

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
