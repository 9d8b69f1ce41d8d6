"""The parts of a world's laws: forms, which are accelerations, and modulations, which multiply them.

A part is written once, as expressions of `laws`. `#` in an expression is replaced by the index of the part in its
world, so that two parts of one kind do not share constants. `scenes.worlds.terms` multiplies a form by the mass of its
body and by its modulations. Local names refer to the body on which the part acts:

- on a floor `x y` [m], `vx vy` [m/s], and `px py`, the applied force over the mass [m/s²];
- on a hinge or a rail `q` [rad or m], `u` [rad/s or m/s], and `pq`, the applied torque or force over the inertia;
- the same with the prefix `o_` for the other puck of a pair, and with `h#_` for the hidden body of the form;
- `t` [s], and `odo`, the smoothed path length of the body [m or rad].
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from scenes.fitting import Array


class Apparatus(StrEnum):
    """Kinds of apparatus, with the bodies that an agent can push."""

    PUCK = "puck"
    """A puck on a floor, which slides along both axes."""
    PAIR = "pair"
    """Two pucks on one floor."""
    WHEEL = "wheel"
    """A wheel on a fixed axle."""
    GLIDER = "glider"
    """A glider on a rail."""

    @property
    def flat(self) -> bool:
        """Whether the bodies move in a plane instead of along one coordinate."""
        return self in {Apparatus.PUCK, Apparatus.PAIR}


DISC = 0.25
"""Smallest magnitude of a constant of scale `disc`, as a share of the largest one."""
RATIO = 0.45, 1.9
"""Open interval around 1 in which no constant of scale `ratio` lies."""


@dataclass(frozen=True, slots=True)
class Range:
    """The distribution of a constant."""

    low: float
    high: float
    scale: str = "log"
    """Kind of distribution:

    `log` or `lin`; `sign`: as `log`, with random sign; `disc`: at least a quarter of `high`, with random sign; `angle`:
    of a full or half turn; `ratio`: below or above 1, but far from it.
    """
    unit: str = "1"

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """The intervals that contain all values."""
        low, high = self.low, self.high
        match self.scale:
            case "sign":
                return (-high, -low), (low, high)
            case "disc":
                return (-high, -DISC * high), (DISC * high, high)
            case "ratio":
                return (low, RATIO[0]), (RATIO[1], high)
            case _:
                return ((low, high),)

    def beyond(self, values: Array) -> Array:
        """Return the distance of values from the nearest interval, relative to the size of its end, or to its width.

        The smaller of the two is used. The distance of an angle is 0, because all angles are possible.
        """
        if self.scale == "angle":
            return np.zeros_like(values)
        distances: list[Array] = []
        for low, high in self.intervals:
            below, above = (min(abs(end) or math.inf, high - low) for end in (low, high))
            distances.append(np.maximum(np.maximum((low - values) / below, (values - high) / above), 0))
        return np.minimum.reduce(distances)


@dataclass(frozen=True, slots=True)
class Form:
    """An acceleration of one body. The first of its constants is its magnitude."""

    name: str
    group: str
    """`drag`, `cross`, `field`, `time`, `body`, `push` or `pair`."""
    says: str
    """Description for authors and for readers of a certificate."""
    constants: dict[str, Range]
    let: dict[str, str]
    force: tuple[str, ...]
    """Components: two on a floor, one otherwise."""
    hidden: tuple[str, ...] = ()
    """Acceleration of the form's hidden body, which starts at rest at 0; empty without a hidden body."""
    reaction: bool = False
    """Whether the other puck of a pair feels the opposite force."""


@dataclass(frozen=True, slots=True)
class Modulation:
    """A factor of a form."""

    name: str
    group: str
    """`place`, `time`, `memory` or `motion`."""
    says: str
    constants: dict[str, Range]
    factor: str
    fits: frozenset[str]
    """Groups of forms that the modulation may multiply."""


TURN, HALF_TURN = Range(0.0, 2 * math.pi, "angle", "rad"), Range(0.0, math.pi, "angle", "rad")
PERIOD = Range(3.0, 9.0, "log", "s")
POWER = Range(1.5, 2.6, "lin")


def size(low: float, high: float, unit: str, scale: str = "log") -> Range:
    """Return the range of the first constant of a form."""
    return Range(low, high, scale, unit)
