"""Pumps a body up in a potential, half swing by half swing, short of a catch. For reference protocols.

Each half swing is planned with all constants that the readings leave plausible: with none of them may the body pass the
reach. Where little is known the body therefore goes less far, and neither an error of the fit nor a force that only the
fit believes in lets it run into the catch.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from scenes.courses import Array
from scenes.protocol import Call, Exchanges, Reading
from scenes.rigs import Rig, lasting
from scenes.works import parts_of_way

_SHARES = np.linspace(1.0, -1.0, 81)
"""Pushes along the motion that are tried, as shares of the strongest."""
_BEYOND, _PLACES = 1.3, 400
"""How far turning places are looked for, in reaches, and at how many places."""
_TURNED = 0.1
"""A body that is nearer to its turning place than this share of its distance from the middle counts as turned."""


@dataclass(frozen=True, slots=True)
class Pump:
    """How a body is pumped up."""

    rig: Rig
    """A push, and what is read after each look."""
    potential: Callable[[Array, Array], Array]
    """Constants and places → potential energy [J]; least at place 0."""
    inertia: Callable[[Array], Array]
    """Constants → mass or moment of inertia [kg, kg·m²]."""
    strongest: float
    """The strongest push [N, N·m]."""
    reach: float
    """How far from the middle the body may go [m, rad]."""
    looks: Callable[[float], Sequence[float]]
    """Where a half swing ends → when to look, in shares of its time; most often at the reach."""
    calls: int
    """Most calls before the answer."""
    time_s: float
    """Time that all of it may take [s]."""
    singly: int
    """Number of half swings that are planned one by one; then two are planned at a time."""

    def pumped(
        self, first: list[Call], plausible: Callable[[Exchanges], Array]
    ) -> Generator[list[Call], list[Reading], list[tuple[Call, Reading]]]:
        """Do the first calls, then half swings as long as calls and time last.

        Args:
            first: Calls that set the body going.
            plausible: What was read → constants that it leaves plausible, the best in column 0.

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
        """Calls of half swings, each planned from where the one before ends.

        Args:
            plausible: Constants of the potential, the best in column 0; shape (constants, members).
            place: Where the body is [m, rad].
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
        """The push along the motion that leads farthest within the reach, and where each member then turns back."""
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
        """Time in which a body that is about to turn back comes to the same place again."""
        step = 1e-4 * self.reach
        around = self.potential(constants[:, None], np.array([place - step, place + step]))
        pull = abs(float(around[1] - around[0]) / (2 * step) - push)
        return 2 * float(self.inertia(constants)) * abs(speed) / pull

    def _duration(self, constants: Array, push: float, start: float, end: float, speed: float) -> float:
        """Time of the way between two places, from a speed at the first."""
        inertia = float(self.inertia(constants))
        energy = inertia * speed**2 / 2 + float(self.potential(constants, np.array(start))) - push * start

        def speed_at(x: Array) -> Array:
            return np.sqrt(np.maximum(2 * (energy + push * x - self.potential(constants, x)) / inertia, 1e-9))

        return float(np.sum(parts_of_way(speed_at, start, end)[0]))


def turning_ways(left: Array, ways: Array) -> Array:
    """The ways after which no kinetic energy is left for the first time; the last way where some is left at all.

    Args:
        left: Kinetic energy along each way; shape (members, places).
        ways: The ways, from 0 on; of the same shape.
    """
    after = np.argmax(left < 0, axis=1)
    rows = np.arange(len(left))
    before = np.maximum(after - 1, 0)
    above, below = left[rows, before], left[rows, after]
    share = np.where(after > 0, above / np.where(after > 0, above - below, 1.0), 0.0)
    crossed = ways[rows, before] + share * (ways[rows, after] - ways[rows, before])
    return np.where(after > 0, crossed, ways[:, -1])
