"""The loads of certificate 11: the largest forces and torques that an agent may apply in a scene, in many combinations.

The loads depend on what the pack permits and on how the bodies move. `holds` checks the catches.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations, product
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from evaluator.answers.engine import Engine
from physment_mcp.errors import RefusedCall
from scenes import Pack

Vector = NDArray[np.float64]
Kind = Literal["force", "torque"]
Pushes = Mapping[tuple[str, Kind], Vector]
"""Body and kind of load → force [N] or torque [N·m] on the body, world axes."""

_KINDS: Sequence[Kind] = ("force", "torque")
_FEELS = 1e-6
"""Smallest response along an axis at which a body counts as movable, as a share of its largest response."""
_AXES = "xyz"
BALL = "created:load"
"""Name of the body of the loading ball."""
_DENSITY = 20000.0
"""Density of balls [kg/m³], so that they are small."""
_PARTS = (0.6, 0.1, 0.02)
"""Masses of balls, as shares of the total mass that an agent may create."""
_DROP_M, _TRIES = 3.0, 12
"""Height from which a ball is dropped [m]; number of attempts, each slightly higher, if a body is in the way."""


@dataclass(frozen=True, slots=True)
class Handle:
    """A direction in which a body can be pushed or turned, with the largest allowed load."""

    body: str
    kind: Kind
    axis: int
    """0, 1, 2 for x, y, z in the world."""
    size: float
    """Largest allowed load [N or N·m]."""

    def load(self, sign: float) -> Vector:
        """The largest load along the axis."""
        return sign * self.size * np.eye(3)[self.axis]

    def __str__(self) -> str:
        return f"{self.body} {self.size:g} {'N' if self.kind == 'force' else 'N·m'} {_AXES[self.axis]}"


def motion(engine: Engine, body: str, kind: Kind) -> Vector:
    """The velocity [m/s] or spin [rad/s] of a body (3,)."""
    twist = engine.twist(body)
    return twist.linear if kind == "force" else twist.angular


def handles_of(engine: Engine, pack: Pack) -> dict[Handle, float]:
    """Return the handles by which an agent can load bodies, each with its response.

    The response is the sum of the speeds that the largest load causes in two time steps. Read-only and fixed bodies
    have no handles. Handles that need a disabled tool, or that have hardly any response, are omitted.
    """
    found: dict[Handle, float] = {}
    start = engine.save()
    engine.step(2)
    untouched: dict[tuple[str, Kind], Vector] = {
        (body, kind): motion(engine, body, kind) for body in engine.bodies for kind in _KINDS
    }
    engine.restore(start)
    for key, listed in pack.objects.items():
        body = f"object_{listed.object_id}"
        if not pack.permissions_of(key).actuate or not engine.is_movable(body):
            continue
        for kind, size in largest(pack).items():
            for axis in range(3):
                handle = Handle(body, kind, axis, size)
                push(engine, {(body, kind): handle.load(1.0)})
                engine.step(2)
                gained = [np.abs(motion(engine, *of) - before).sum() for of, before in untouched.items()]
                found[handle] = float(sum(gained))
                engine.restore(start)
    least = _FEELS * max(found.values(), default=0.0)
    return {handle: response for handle, response in found.items() if response > least}


def largest(pack: Pack) -> dict[Kind, float]:
    """Return the largest force [N] and torque [N·m] on an object; 0 if the tool for it is disabled."""
    limits = pack.limits
    if limits is None:
        return {}
    sizes: dict[Kind, float | None] = {"force": limits.force, "torque": limits.torque}
    return {kind: size for kind, size in sizes.items() if size and f"apply_{kind}" not in pack.disabled_tools}


def unbounded_tools(pack: Pack) -> list[str]:
    """Return the enabled tools that can change the motion of a body by any amount, so that no catch could stop it.

    `detect_collision` is not one of these tools: its elastic bounce only exchanges momentum between touching bodies.
    """
    limits = pack.limits
    always = ("move_object", "change_position", "set_velocity")
    open_tools = [tool for tool in always if tool not in pack.disabled_tools]
    for kind in _KINDS:
        tool = f"apply_{kind}"
        if tool not in pack.disabled_tools and (limits is None or getattr(limits, kind) is None):
            open_tools.append(tool)
    if "create_objects" not in pack.disabled_tools and (limits is None or limits.created_mass is None):
        open_tools.append("create_objects")
    return open_tools


def push(engine: Engine, pushes: Pushes) -> None:
    """Apply the given loads; loads on other handles stay unchanged."""
    for (body, kind), vector in pushes.items():
        if kind == "force":
            engine.push(body, force=vector)
        else:
            engine.push(body, torque=vector)


@dataclass(frozen=True, slots=True)
class Ball:
    """A ball that loads a body: joined to it, or dropped on it."""

    body: str
    share: float
    """Position along the body's largest extent, from -1 to 1; the extent along its axle is ignored."""
    mass: float
    """Mass [kg]."""
    height: float | None
    """Height from which the ball falls [m]; None if it is joined to the body."""
    axle: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Unit vector along the body's hinge axis; zeros without a hinge."""

    def put(self, engine: Engine) -> bool:
        """Create the ball; returns False if there is no room for it."""
        radius = (3 * self.mass / (4 * math.pi * _DENSITY)) ** (1 / 3)
        box = engine.shape(self.body).box
        extent = np.zeros(3) if box is None else box * (1 - np.array(self.axle))
        along = np.eye(3)[int(np.argmax(extent))] * self.share * extent.max() / 2
        place = engine.pose(self.body).position + along + [0.0, 0.0, self.height or 0.0]
        obstacles = {name: name for name in engine.bodies}
        for _ in range(_TRIES):
            try:
                engine.add_ball(BALL, place, _DENSITY, radius, np.ones(4), obstacles)
            except RefusedCall:
                place[2] += max(radius, extent.max() / 10, 0.01)
                continue
            with suppress(RefusedCall):
                if self.height is None:
                    engine.join(BALL, self.body, "weld")
            return True
        return False


def axle(engine: Engine, body: str) -> tuple[float, ...]:
    """The unit vector along x, y or z that is nearest to the only hinge of a body; zeros without one."""
    if engine.turn(body) is None:
        return (0.0, 0.0, 0.0)
    start, spins = engine.save(), np.zeros(3)
    for axis, sign in product(range(3), (1.0, -1.0)):  # the difference cancels the effect of laws
        push(engine, {(body, "torque"): sign * np.eye(3)[axis]})
        engine.step(1)
        spins[axis] += sign * float(motion(engine, body, "torque")[axis])
        engine.restore(start)
    return tuple(np.eye(3)[int(np.argmax(np.abs(spins)))].tolist())


def removals(engine: Engine, pack: Pack) -> list[tuple[str, ...]]:
    """Return the sets of fixed objects to delete at the start of a run: all of them, each one alone, and none."""
    if "delete_objects" in pack.disabled_tools:
        return [()]
    listed = {f"object_{entry.object_id}": key for key, entry in pack.objects.items()}
    fixed = [body for body, key in listed.items() if pack.permissions_of(key).actuate and not engine.is_movable(body)]
    return list(dict.fromkeys([tuple(fixed), *((body,) for body in fixed), ()]))


def take_away(engine: Engine) -> None:
    """Delete the ball, if there is one."""
    if BALL in engine.bodies:
        engine.remove(BALL)


@dataclass(frozen=True, slots=True)
class Attack:
    """A combination of loads on handles, or a ball. Before an attack starts, all earlier loads are removed."""

    name: str
    parts: tuple[tuple[Handle, float], ...]
    """Handles, each with its initial load as a share of the largest one; negative for the opposite direction."""
    way: Literal["constant", "pumped", "along"] = "constant"
    """`pumped`: each load reverses when the motion along its axis reverses. `along`: the load follows the velocity."""
    ball: Ball | None = None
    """A ball that is created at the beginning of the attack and deleted at its end."""

    def reversed(self) -> "Attack":
        """An attack with the opposite loads, constant and without a ball."""
        return Attack(f"{self.name} reversed", tuple((handle, -sign) for handle, sign in self.parts))

    def pushes(self, engine: Engine) -> Pushes:
        """Return the loads for the present motion."""
        loads: dict[tuple[str, Kind], Vector] = {}
        for handle, sign in self.parts:
            of = (handle.body, handle.kind)
            load = handle.load(sign)
            if self.way != "constant":
                moving = motion(engine, *of)
                speed = float(np.linalg.norm(moving)) if self.way == "along" else abs(float(moving[handle.axis]))
                if speed > 0:
                    along = moving if self.way == "along" else moving * np.eye(3)[handle.axis]
                    load = handle.size * along / speed
            loads[of] = load
        return loads


RELEASE = Attack("no load", ())


def attacks_on(handles: Sequence[Handle], engine: Engine, pack: Pack) -> list[Attack]:
    """Return all attacks: constant and `pumped` loads on each handle, loads `along` the motion, and pairs of loads.

    Attacks with a tenth of the load bring a body to other positions and speeds before the largest load follows. If
    balls can be created, they are joined to every body and dropped on it.
    """
    found = [*_constant(handles), *_following(handles), *_pairs(handles), *_balls(engine, pack)]
    return [*found, RELEASE]


def _constant(handles: Sequence[Handle]) -> Iterator[Attack]:
    for handle in handles:
        for sign, mark in ((1.0, "+"), (-1.0, "-")):
            yield Attack(f"{handle}{mark}", ((handle, sign),))
            yield Attack(f"a tenth of {handle}{mark}", ((handle, sign / 10),))


def _following(handles: Sequence[Handle]) -> Iterator[Attack]:
    for handle in handles:
        yield Attack(f"{handle} pumped", ((handle, 1.0),), "pumped")
    for body, kind in dict.fromkeys((handle.body, handle.kind) for handle in handles):
        own = [handle for handle in handles if (handle.body, handle.kind) == (body, kind)]
        if len(own) > 1:
            yield Attack(f"{body} {kind} along its motion", ((own[0], 1.0),), "along")


def _balls(engine: Engine, pack: Pack) -> Iterator[Attack]:
    """Attacks with balls of different shares of the allowed mass, so that a run can contain several."""
    if "create_objects" in pack.disabled_tools or pack.limits is None or pack.limits.created_mass is None:
        return
    joins = "attach_objects" not in pack.disabled_tools
    axles = {body: axle(engine, body) for body in engine.bodies}
    for part, share in product(_PARTS, (0.0, 0.9, -0.9)):
        for key, listed in pack.objects.items():
            body, mass = f"object_{listed.object_id}", part * pack.limits.created_mass
            if not engine.is_movable(body):
                continue
            heights = [*([None] if joins and pack.permissions_of(key).actuate else []), 0.0, _DROP_M]
            for height in heights:
                how = "joined to" if height is None else f"from {height:g} m on"
                yield Attack(
                    f"{mass:.3g} kg {how} {body} at {share:g}", (), ball=Ball(body, share, mass, height, axles[body])
                )


def _pairs(handles: Sequence[Handle]) -> Iterator[Attack]:
    for first, second in combinations(handles, 2):
        if first.body == second.body:
            continue
        for sign in (1.0, -1.0):
            yield Attack(f"{first}+ and {second}{'+' if sign > 0 else '-'}", ((first, 1.0), (second, sign)))
            yield Attack(f"{first}- and {second}{'-' if sign > 0 else '+'}", ((first, -1.0), (second, -sign)))
        yield Attack(f"{first} and {second} pumped", ((first, 1.0), (second, 1.0)), "pumped")
