"""Loads an apparatus with balls of known mass, and measures its response. Used by reference protocols.

A ball of density ρ and radius r has the mass m = 4/3 π r³ ρ. It is created next to the apparatus and attached to it.
"""

from collections import defaultdict
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import cos, pi
from typing import Any

import numpy as np

from scenes.course_record import Course, accepted
from scenes.protocol import Call, Exchanges, Reading, call

GRAVITY = 9.81
"""Acceleration of free fall in the scenes [m/s²]."""
_RED = (1, 0, 0, 1)
_REST_S = 1.0
"""After a longer step the body is assumed to be at rest; shorter steps observe its motion."""


def ball(name: str, kg: float, place: Sequence[float], radius: float) -> Call:
    """Return the call that creates a ball with a mass [kg] and a radius [m]."""
    density = kg / (4 / 3 * pi * radius**3)
    return call("create_objects", name=name, pos=list(place), density=density, rgba=list(_RED), radius=radius)


def dense_ball(name: str, kg: float, place: Sequence[float], density: float) -> Call:
    """Return the call that creates a ball with a mass [kg] and a density [kg/m³]."""
    radius = (kg / density / (4 / 3 * pi)) ** (1 / 3)
    return call("create_objects", name=name, pos=list(place), density=density, rgba=list(_RED), radius=radius)


def joined(ball: Call, body: str) -> list[Call]:
    """Return the calls that create a ball and attach it to a body."""
    return [ball, call("attach_objects", object1_id=ball.arguments["name"], object2_id=body)]


def mass_of(asked: Call) -> float:
    """Return the mass [kg] of the ball that a call creates."""
    return asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3


def looks(body: str, spans: Sequence[float]) -> list[Call]:
    """Return calls that wait for each of the durations [s], and read the position of a body after each."""
    return [made for span in spans for made in (call("step", duration=span), call("get_position", object_id=body))]


def hung(exchanges: Exchanges) -> Iterator[tuple[Call, Reading, Mapping[str, float]]]:
    """Yield each successful call with its result, and the total mass [kg] of the balls on each body after the call."""
    made, places, load = dict[str, float](), dict[str, str](), defaultdict[str, float](float)
    for asked, reading in accepted(exchanges):
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = mass_of(asked)
        elif asked.tool == "attach_objects" and asked.arguments["object1_id"] in made:
            name, body = asked.arguments["object1_id"], asked.arguments["object2_id"]
            places[name] = body
            load[body] += made[name]
        elif asked.tool == "delete_objects" and asked.arguments["object_id"] in places:
            name = asked.arguments["object_id"]
            load[places[name]] -= made[name]
        yield asked, reading, load


def torque_at_spin(engine: Any, body: str, spin: float, stiff: float, lasting: float, seconds: float = 40.0) -> float:
    """Find the torque that keeps a wheel at an angular velocity in the engine, by a PI controller [N·m].

    Args:
        engine: The engine, with a body `trigger` and other forces already set.
        body: The wheel.
        spin: Its angular velocity [rad/s].
        stiff: Proportional gain [N·m·s].
        lasting: Integral gain for each time step [N·m·s].
        seconds: Time until the angular velocity is steady [s].
    """
    torque = 0.0
    for _ in range(engine.whole_steps(seconds)):
        lack = spin - float(engine.turn(body).spin)
        torque += lasting * lack
        engine.push(body, torque=np.array([0.0, 0.0, torque + stiff * lack]))
        engine.step(1)
    return torque


@dataclass(frozen=True, slots=True)
class Pan:
    """A pan that sinks under a ball; each ball replaces the previous one."""

    top_m: float
    """Height of the pan at the start."""
    catch_m: float
    """Deflection at which a catch holds the pan permanently."""
    radius: float = 0.06
    """Radius of the balls [m]."""
    body: str = "object_1"

    def load(self, number: int, kg: float, spans: Sequence[float], radius: float | None = None) -> list[Call]:
        """Return calls that replace the ball on the pan by ball `number`, and read the pan after each duration [s]."""
        where = [0.0, 0.3 * (number % 2) - 0.15, self.top_m]
        old = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
        return [
            *joined(ball(f"b{number}", kg, where, radius or self.radius), self.body),
            *old,
            *looks(self.body, spans),
        ]

    def scaled(
        self, first_kg: float, growth: float, seen_m: float, settle_s: float
    ) -> Generator[list[Call], list[Reading], tuple[list[tuple[Call, Reading]], int, float]]:
        """Load ever heavier balls until the pan sinks measurably.

        Args:
            first_kg: Mass of the first ball [kg].
            growth: Ratio of each ball's mass to the previous one.
            seen_m: Deflection that counts as measurable [m].
            settle_s: Time after which the pan is read [s].

        Returns:
            The exchanges, and number and mass [kg] of the next ball.
        """
        seen, number, kg = list[tuple[Call, Reading]](), 0, first_kg
        while not seen or self.course(seen).readings[-1, 0] < seen_m:
            calls = self.load(number, kg, [settle_s])
            seen += zip(calls, (yield calls), strict=True)
            number, kg = number + 1, kg * growth
        return seen, number, kg

    def pressed(self, engine: Any, newtons: float, seconds: float) -> Any:
        """Return the engine without the catch, after a force has pressed the pan down."""
        free = engine.changed({"joint[guide].range": (-5.0, 20.0), "body[trigger]/inertial.mass": 1e12})
        free.push(self.body, force=np.array([0.0, 0.0, -newtons]))
        free.step(free.whole_steps(seconds))
        return free

    def way(self, engine: Any) -> float:
        """Return the deflection of the pan in the engine [m]."""
        return self.top_m - float(engine.pose(self.body).position[2])

    def course(self, exchanges: Exchanges) -> Course:
        """Return weights [N] and deflections [m] of the pan, until the catch holds it."""
        legs = list[list[float]]()
        for asked, reading, load in hung(exchanges):
            if asked.tool == "step":
                legs.append([asked.arguments["duration"], load[self.body] * GRAVITY, np.nan])
            elif asked.tool == "get_position" and legs:
                way = self.top_m - reading["position"][2]
                if way > self.catch_m + 0.005:
                    legs.pop()
                    break
                legs[-1][2] = way
        times, loads, ways = np.array(legs or [[1.0, 1.0, 0.1]]).T
        return Course(times, loads[:, None], ways[:, None])


@dataclass(frozen=True, slots=True)
class Lever:
    """A body on an axle, turned step by step by attached balls, slowly enough not to trigger a safety brake.

    A ball of mass m that is attached at the height of the axle while the body is at angle b exerts the torque
    m g l cos(a - b) at the angle a.
    """

    widest: float
    """Largest allowed angle of the body [rad]."""
    enough: float
    """Angle at which loading ends [rad]."""
    fastest: float
    """Angular velocity above which the device brakes [rad/s]."""
    share: float
    """Share of `fastest` that the angular velocity should reach after the next ball."""
    room: float
    """One ball is attached at a time if the angle left is smaller than this many times the angle gained last."""
    first_kg: float
    most: int
    """Largest number of balls."""
    singly: int
    """Number of balls that are attached one at a time at first; later ones are attached two at a time."""
    look_s: float
    """Time after attaching at which the first angular velocity is read [s]."""
    wait_s: float = 6.0
    """Time for the body to come to rest [s]."""
    arm_m: float = 0.5
    height_m: float = 1.0
    apart_m: float = 0.05
    """Distance between the balls along the axle, which has no effect on the torque."""
    radius: float = 0.02
    name: str = "ball"
    body: str = "object_1"

    def ball(self, number: int, kg: float, radius: float | None = None) -> list[Call]:
        """Return calls that attach ball `number` next to the axle, at the height of the axle."""
        side = 1 if number % 2 else -1
        place = [self.arm_m, side * (0.1 + self.apart_m * (number // 2)), self.height_m]
        return joined(ball(f"{self.name}{number}", kg, place, radius or self.radius), self.body)

    def look(self) -> list[Call]:
        """Return calls that read the angular velocity shortly after a ball was attached."""
        return [call("step", duration=self.look_s), call("get_velocity", object_id=self.body)]

    def rest(self) -> list[Call]:
        """Return calls that read the angle at rest."""
        return looks(self.body, [self.wait_s])

    def turned(self) -> Generator[list[Call], list[Reading], tuple[list[tuple[Call, Reading]], int]]:
        """Attach balls until the angle is large enough, each as heavy as possible without triggering the brake.

        The mass of each ball is computed from the angular velocity after the previous ball; it grows at most eightfold.

        Returns:
            The exchanges and the number of balls.
        """
        seen, kg, way, gained, number = list[tuple[Call, Reading]](), self.first_kg, 0.0, 0.0, 0
        while number < self.most and way < self.enough:
            count = 1 if number < self.singly or self.widest - way < self.room * gained else 2
            calls: list[Call] = []
            for other in range(number, number + count - 1):
                calls += [*self.ball(other, kg), *self.rest()]
            calls += [*self.ball(number + count - 1, kg), *self.look(), *self.rest()]
            readings = yield calls
            seen += zip(calls, readings, strict=True)
            number += count
            before = way if count == 1 else readings[3]["angle"]
            gained, way = readings[-1]["angle"] - before, readings[-1]["angle"]
            most = self.share * self.fastest / max(readings[-3]["angular_velocity"], 0.001)
            kg *= min(8.0, most, 0.9 * max(self.widest - way, 0.0) / max(gained, 1e-3))
        return seen, number

    def torques(self, exchanges: Exchanges) -> list[tuple[float, float]]:
        """Return the torque of the balls [N·m] and the angle [rad] of each equilibrium within the allowed range."""
        balls, made, rows = dict[str, tuple[float, float]](), dict[str, float](), list[tuple[float, float]]()
        angle = last = 0.0
        for asked, reading in exchanges:
            if "error" in reading:
                continue
            if asked.tool == "create_objects":
                made[asked.arguments["name"]] = mass_of(asked)
            elif asked.tool == "attach_objects":
                name = asked.arguments["object1_id"]
                balls[name] = (made[name], angle)
            elif asked.tool == "delete_objects":
                balls.pop(asked.arguments["object_id"])
            elif asked.tool == "step":
                last = asked.arguments["duration"]
            elif asked.tool == "get_position":
                angle = reading["angle"]
                if abs(angle) > self.widest:
                    break
                if last > _REST_S:
                    rows.append((sum(kg * GRAVITY * self.arm_m * cos(angle - b) for kg, b in balls.values()), angle))
        return rows
