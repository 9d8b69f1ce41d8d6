"""Increases the swings of a body in a potential by pushes, without reaching a catch. Used by reference protocols.

Each half swing is planned so that the body stays within the reach for all constants that the readings allow. If little
is known, the body therefore swings less far, and an error of the fit does not let it reach the catch.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.fitting import Array
from scenes.protocol import Call, Exchanges, Reading
from scenes.rigs import Rig, lasting
from scenes.works import parts_of_way

_SHARES = np.linspace(1.0, -1.0, 81)
"""Candidate pushes along the motion, as fractions of the strongest."""
_BEYOND, _PLACES = 1.3, 400
"""Distance in which turning points are searched, in units of the reach, and number of positions searched."""
_TURNED = 0.1
"""A body counts as turned within this fraction of its turning point's distance from the middle."""


@dataclass(frozen=True, slots=True)
class Pump:
    """Plans the pushes that increase the swings of a body."""

    rig: Rig
    """The push, and the readings after each look."""
    potential: Callable[[Array, Array], Array]
    """Constants and positions → potential energy [J]; smallest at position 0."""
    inertia: Callable[[Array], Array]
    """Constants → mass or moment of inertia [kg, kg·m²]."""
    strongest: float
    """The strongest push [N, N·m]."""
    reach: float
    """Largest distance from the middle that the body may reach [m, rad]."""
    looks: Callable[[float], Sequence[float]]
    """End of a half swing → times of its readings, as fractions of its duration; most readings are near the reach."""
    calls: int
    """Largest number of calls before the answer."""
    time_s: float
    """Largest total duration [s]."""
    singly: int
    """Number of half swings that are planned one at a time; later ones are planned two at a time."""

    def pumped(
        self, first: list[Call], plausible: Callable[[Exchanges], Array]
    ) -> Generator[list[Call], list[Reading], list[tuple[Call, Reading]]]:
        """Make the first calls, then half swings until the limit of calls or of time is reached.

        Args:
            first: Calls that set the body in motion.
            plausible: Function of the exchanges; returns sets of constants that the readings allow, the best-fit set in
                column 0.

        Returns:
            The exchanges.
        """
        seen, calls, number = list[tuple[Call, Reading]](), first, 0
        largest = len(self.rig.along(0.0, self.looks(self.reach)))
        place, speed = self.rig.readings
        while calls and lasting([call for call, _ in seen] + calls) <= self.time_s:
            seen += zip(calls, (yield calls), strict=True)
            room = min((self.calls - len(seen)) // largest, 1 if number < self.singly else 2)
            now = place.of(seen[-2][1]), speed.of(seen[-1][1])
            calls = self.half_swings(plausible(seen), *now, room) if room > 0 else []
            number += 1
        return seen

    def half_swings(self, plausible: Array, place: float, speed: float, number: int) -> list[Call]:
        """Return the calls of half swings, each planned from the end of the previous one.

        Args:
            plausible: Sets of constants of the potential, the best-fit set in column 0; shape (constants, sets).
            place: Position of the body [m, rad].
            speed: Its speed [m/s, rad/s].
            number: Number of half swings.
        """
        calls, places = list[Call](), np.full(plausible.shape[1], place)
        side = float(np.sign(speed)) or -float(np.sign(place))
        for _ in range(number):
            push, ends = self._planned(plausible, places, speed, side)
            lingers = 0.0
            if speed and 0 < side * (ends[0] - place) < _TURNED * abs(ends[0]):
                side = -side
                push, ends = self._planned(plausible, places, speed, side)
                lingers = self._back(plausible[:, 0], place, speed, push)
            lasts = lingers + self._duration(plausible[:, 0], push, float(places[0]), float(ends[0]), speed)
            calls += self.rig.along(push, (lasts * share for share in self.looks(float(ends[0]))))
            places, speed, side = ends, 0.0, -side
        return calls

    def _planned(self, plausible: Array, places: Array, speed: float, side: float) -> tuple[float, Array]:
        """Return the strongest push that keeps the body within reach for all constants, and the turning points."""
        far = side * _BEYOND * self.reach
        ways = (far - places)[:, None] * np.linspace(0.0, 1.0, _PLACES)
        rises = self.potential(plausible[:, :, None], places[:, None] + ways)
        energies = self.inertia(plausible)[:, None] * speed**2 / 2 - (rises - rises[:, :1])
        push, ends = 0.0, places
        for share in _SHARES:
            push = float(side * share * self.strongest)
            ends = places + turning_ways(energies + push * ways, ways)
            if np.max(side * ends) <= self.reach:
                break
        return push, ends

    def _back(self, constants: Array, place: float, speed: float, push: float) -> float:
        """Return the time until a body that moves away from the middle turns and passes its present position again."""
        step = 1e-4 * self.reach
        around = self.potential(constants[:, None], np.array([place - step, place + step]))
        pull = abs(float(around[1] - around[0]) / (2 * step) - push)
        return 2 * float(self.inertia(constants)) * abs(speed) / pull

    def _duration(self, constants: Array, push: float, start: float, end: float, speed: float) -> float:
        """Return the travel time between two positions, from a speed at the first."""
        inertia = float(self.inertia(constants))
        energy = inertia * speed**2 / 2 + float(self.potential(constants, np.array(start))) - push * start

        def speed_at(x: Array) -> Array:
            return np.sqrt(np.maximum(2 * (energy + push * x - self.potential(constants, x)) / inertia, 1e-9))

        return float(np.sum(parts_of_way(speed_at, start, end)[0]))


def turning_ways(left: Array, ways: Array) -> Array:
    """Return for each path the distance at which the kinetic energy falls to 0; the last distance if it never does.

    Args:
        left: Kinetic energy along each path; shape (paths, places).
        ways: Distances along each path, from 0 on; the same shape.
    """
    after = np.argmax(left < 0, axis=1)
    rows = np.arange(len(left))
    before = np.maximum(after - 1, 0)
    above, below = left[rows, before], left[rows, after]
    share = np.where(after > 0, above / np.where(after > 0, above - below, 1.0), 0.0)
    crossed = ways[rows, before] + share * (ways[rows, after] - ways[rows, before])
    return np.where(after > 0, crossed, ways[:, -1])
