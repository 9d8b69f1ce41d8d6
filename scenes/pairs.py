"""Two bodies that something joins: what is passed on between them, from impulses. For reference protocols.

Over an interval the momentum of each body changes by the impulse of all that acts. With speeds and places at both ends,
the integrals of v, sign(v) and v|v| follow, so that the balance of each body is linear in masses, resistances and gear
ratio n. What the second body takes beyond its own balance, the joint passes on. Its law, against the slip n v1 - v2, is
`rigid` (no slip), `clutch` (a greatest force) or `fluid` (in proportion to the slip).
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from scenes.courses import Array
from scenes.protocol import Call, Exchanges, Reading, call

BODIES = ("object_1", "object_2")
Windows = Mapping[str, Array]
"""Columns of the intervals: duration `dt`; impulses `F`, `G` of the forces on both; changes of speed `d1`, `d2`; ways
`x1`, `x2`; `s1`, `s2` integrals of sign(v); `q2` integral of v2|v2|; `v1`, `v2` first and `w1`, `w2` last speeds;
`e2` error of `q2`; `rests` where the second body rests; `turns`, the share in which a body may have turned round or
stopped; `pauses`, that in which the second body may have rested between two motions."""


def state() -> list[Call]:
    """Read places, then speeds of both."""
    return [call(tool, object_id=body) for tool in ("get_position", "get_velocity") for body in BODIES]


def states(exchanges: Exchanges) -> Array:
    """Rows of time, places and speeds of both, and the forces since the row before, from the start on."""
    rows, forces, found = [(0.0,) * 7], dict.fromkeys(BODIES, 0.0), list[float]()
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            forces[asked.arguments["object_id"]] = asked.arguments["force_vector"][0]
        elif asked.tool in ("get_position", "get_velocity"):
            found.append(reading[asked.tool.removeprefix("get_")][0])
            if len(found) == 4:
                rows.append((reading["sim_time"], *found, *forces.values()))
                found = []
    return np.array(rows)


def until_caught(rows: Array, net: float) -> Array:
    """The rows up to the first one in which a body is beyond this distance from the origin."""
    return rows[np.logical_and.accumulate(np.all(np.abs(rows[:, 1:3]) < net, axis=1))]


def signs(first: Array, last: Array, duration: Array) -> Array:
    """Integral of the sign of a speed that changes evenly."""
    return duration * (abs(last) - abs(first)) / np.where(abs(last - first) > 1e-9, last - first, 1.0) * (
        first * last < 0
    ) + duration * np.sign(first + last) * (first * last >= 0)


_CURVED, _SQUARED, _NEAR_ENDS = 0.1, 0.002, 0.05
"""Error of an integral of v|v|, over its difference to that of an even change of speed, and over that of v²; share of
the change of speed by which its mean has to lie off its ends for an exponential course."""
_LEVEL = 0.02
"""Change of speed below which its course is taken for even [m/s]."""
_NODES, _BEND = 32, np.linspace(-12.0, 12.0, 481) + 1e-6
"""Parts of an interval in which its integrals are computed; exponents by which a speed may fade in an interval."""
_MEAN = 1 / _BEND - 1 / np.expm1(_BEND)
"""Mean of a speed that fades from 1 to 0 with such an exponent."""


def speeds(first: Array, last: Array, mean: Array) -> Array:
    """Speeds at even moments of each interval, of a motion which nears a steady speed exponentially.

    Where ends and mean do not allow this, the speed is a parabola of the time.

    Args:
        first: Speed at the start [m/s].
        last: Speed at the end [m/s].
        mean: Way over duration [m/s].

    Returns:
        A row for each moment.
    """
    change = last - first
    share = (mean - last) / np.where(abs(change) > 1e-9, -change, 1.0)
    bend = np.where(abs(change) > _LEVEL, np.interp(-share, -_MEAN, _BEND), 1e-6)
    moments = np.linspace(0.0, 1.0, _NODES + 1)[:, None]
    fading = first + change * np.expm1(-bend * moments) / np.expm1(-bend)
    arched = first + change * moments + (6 * mean - 3 * (first + last)) * moments * (1 - moments)
    return np.where((share > _NEAR_ENDS) & (share < 1 - _NEAR_ENDS), fading, arched)


def _squares(course: Array, duration: Array) -> Array:
    """Integral of v|v| of speeds at even moments."""
    size = course * np.abs(course)
    return duration * np.mean((size[1:] + size[:-1]) / 2, axis=0)


def _senses(course: Array, duration: Array) -> Array:
    """Integral of the sign of a speed that is known at even moments."""
    return signs(course[:-1], course[1:], duration / _NODES).sum(axis=0)


def windows(rows: Array, slow: float, still: float, near: float) -> dict[str, Array]:
    """The intervals between rows in which things move.

    Args:
        rows: As `states` returns them.
        slow: Sum of the first and the last speed of the first body from which on it moves [m/s].
        still: Way, or speed at an end, below which a body may rest [m, m/s].
        near: Way from which on a body moves [m].
    """
    (t, x1, x2, v1, v2, *_), (u, y1, y2, w1, w2, force, other) = rows[:-1].T, rows[1:].T
    dt, way2 = u - t, y2 - x2
    course, moments = speeds(v2, w2, way2 / dt), np.linspace(0.0, 1.0, _NODES + 1)[:, None]
    square, even = _squares(course, dt), _squares(v2 + (w2 - v2) * moments, dt)
    win = {"F": force * dt, "G": other * dt, "dt": dt, "d1": w1 - v1, "d2": w2 - v2, "x1": y1 - x1, "x2": way2}
    win |= {
        "s1": _senses(speeds(v1, w1, (y1 - x1) / dt), dt),
        "s2": _senses(course, dt),
        "q2": square,
        "v1": v1,
        "w1": w1,
        "v2": v2,
        "w2": w2,
    }
    win["e2"] = _CURVED * abs(square - even) + _SQUARED * dt * np.mean(course**2, axis=0)
    win["rests"] = abs(way2) < still
    ends = np.minimum(abs(w1), abs(w2)) < still
    win["turns"] = 0.05 * ((v1 * w1 < 0) | (v2 * w2 < 0)) + 0.5 * ends
    win["pauses"] = 0.5 * ((v2 * w2 < 0) | (np.minimum(abs(v2), abs(w2)) < still))
    moving = (abs(v1) + abs(w1) > slow) | (abs(y1 - x1) > near) | (abs(way2) > near)
    return {name: column[moving] for name, column in win.items()}


def joint_misfits(
    kind: str, ratio: float, power: float, taken: Array, error: Array, win: Windows, sigma: float
) -> list[Array]:
    """Misfits of what a joint passes on, in its uncertainties.

    Args:
        kind: `rigid`, `clutch` or `fluid`.
        ratio: Gear ratio n.
        power: Greatest force of a clutch [N], or force per slip of a fluid [N·s/m].
        taken: Impulse that the second body took in each interval [N·s].
        error: Uncertainty of it [N·s].
        win: The intervals.
        sigma: Standard deviation of a difference of two readings [m, m/s].
    """
    slip = ratio * win["v1"] - win["v2"], ratio * win["w1"] - win["w2"]
    way, unsure = ratio * win["x1"] - win["x2"], win["rests"] * 1e3
    tolerance = 0.012 + 0.003 * (abs(win["v1"]) + abs(win["w1"]))
    stuck = (abs(slip[0]) < tolerance) & (abs(slip[1]) < tolerance) & (abs(way) < 0.01)
    if kind == "fluid":
        error = np.hypot(error, 0.0004 * power * abs(slip[1] - slip[0]))
        return [(taken - power * way) / np.hypot(error, sigma * power) / (1 + unsure)]
    if kind == "rigid":
        return [way / sigma / 4]
    passed = power * signs(slip[0], slip[1], win["dt"])
    held = np.hypot(way / sigma / 4, np.maximum(abs(taken) - power * win["dt"], 0.0) / error / (1 + unsure))
    mixed = (slip[0] * slip[1] < 0) | (abs(slip[0]) < tolerance) | (abs(slip[1]) < tolerance)
    error = np.hypot(error, mixed * 0.5 * power * win["dt"])
    return [np.where(stuck, held, (taken - passed) / error / (1 + unsure))]


def slides(ratio: float, win: Windows, sigma: float) -> NDArray[np.bool_]:
    """Intervals in which a clutch slips all the time, in one sense."""
    first, last = ratio * win["v1"] - win["v2"], ratio * win["w1"] - win["w2"]
    return (first * last > 0) & (np.minimum(abs(first), abs(last)) > 12 * sigma + 0.004 * abs(win["v1"] + win["w1"]))


def ratios(kind: str, win: Windows, sigma: float) -> list[float]:
    """Gear ratios to begin a fit with: the usual ratio of speeds, or many for a clutch that slips."""
    seen = np.clip(win["w2"] / np.where(abs(win["w1"]) > 0.03, win["w1"], np.inf), 0.0, 4.0)
    if kind == "clutch":
        return [n for n in [*np.geomspace(0.35, 3.0, 24), *seen[seen > 0.25]] if slides(n, win, sigma).any()]
    return [float(np.median(seen))]


def robust(table: Array, right: Array, size: Array) -> Array:
    """Least squares, with less weight on what fits badly."""
    weights, found = 1 / size, np.zeros(table.shape[1])
    for _ in range(6):
        found = cast(Array, np.linalg.lstsq(table * weights[:, None], right * weights, rcond=1e-10)[0])
        weights = 1 / size / np.sqrt(1 + ((table @ found - right) / size / 3) ** 2)
    return found


def refined_constants(
    misfits: Callable[[Array], Array], starts: Sequence[Array], low: Array, high: Array, *, keeps_ratio: bool
) -> tuple[float, Array]:
    """Cost and constants of the best fit from one of the starts.

    Args:
        misfits: Misfits of the constants, the gear ratio first.
        starts: Where the fit begins.
        low: Lower bounds.
        high: Upper bounds.
        keeps_ratio: Whether the gear ratio stays within 10 % of its start.
    """
    best = (1e6, np.clip(np.ones(len(low)), low, high))
    for start in starts:
        lower, upper = low.copy(), high.copy()
        if keeps_ratio:
            lower[0], upper[0] = 0.9 * start[0], 1.1 * start[0]
        scale = np.maximum(start, 0.1)
        found = least_squares(misfits, start, bounds=(lower, upper), x_scale=scale, loss="soft_l1", max_nfev=60)
        if found.cost < best[0]:
            best = (float(found.cost), found.x)
    return best


def clear(place: float, speed: float, rate: float, gain: float, duration: float, room: float, brake: float) -> bool:
    """Whether a body under an acceleration stays within ±room, also while it is stopped after the duration.

    Args:
        place: Where it is [m].
        speed: Its speed [m/s].
        rate: Its acceleration [m/s²].
        gain: Its acceleration per force [1/kg].
        duration: How long it is accelerated [s].
        room: Distance from the origin that it may not exceed [m].
        brake: Force that surely stops it [N].
    """
    end, then = place + speed * duration + rate * duration**2 / 2, speed + rate * duration
    stop = then * abs(then) / (2 * brake * gain)
    return not (abs(end) > room or abs(end + stop) > room)


_STRIDE_S, _STOP_S, _MARGIN = 0.04, 1.2, 1.4
"""Step of a prediction of the motion; time in which a body is stopped; by how much forces may act more than seen."""
_ROUGH, _USUAL = 0.03, np.array([2.0, 2.0, 3.0, 3.0, 1.0])
"""Error of the rough law by which pushes are chosen [m/s]; usual sizes of its constants."""


@dataclass(frozen=True, slots=True)
class Tour:
    """Pushes one after the other, each as long as both bodies stay clear of the nets."""

    pairs: Sequence[tuple[float, float]]
    """Forces on both, before their sense is chosen [N]."""
    times: Sequence[float]
    """Durations from which one is chosen, the longest first [s]."""
    room: float
    """Distance from the origin that no body may exceed [m]."""
    force: float
    """Greatest force [N]."""
    sealed: bool
    """Whether only the first body can be pushed."""

    def push(self, forces: Sequence[float], duration: float, looks: int = 2) -> list[Call]:
        """Calls that push and look after even parts of the duration."""
        pushes = [
            call("apply_force", object_id=body, force_vector=[float(force), 0, 0])
            for body, force in zip(BODIES[: 1 if self.sealed else 2], forces, strict=False)
        ]
        return [*pushes, *([call("step", duration=duration / looks), *state()] * looks)]

    def driven(self) -> Generator[list[Call], list[Reading], list[tuple[Call, Reading]]]:
        """Push pair by pair; returns the exchanges."""
        seen, sense = list[tuple[Call, Reading]](), 1.0
        for pair in self.pairs:
            forces, duration = self._chosen(pair, states(seen), sense)
            turned = forces[0] * pair[0] * sense < 0 or forces[1] * pair[1] * sense < 0
            sense = -sense if pair[0] * pair[1] < 0 or turned else sense
            calls = self.push(forces, duration)
            seen += zip(calls, (yield calls), strict=True)
        return seen

    def _chosen(self, pair: tuple[float, float], rows: Array, sense: float) -> tuple[tuple[float, ...], float]:
        """Forces and time: in this sense as long as the nets are far, else in the other, else against the motion."""
        brake = tuple(-self.force * float(np.sign(speed)) for speed in rows[-1, 3:5])
        if len(rows) < 2:
            return pair, self.times[-2]
        tries = [(pair, sense, duration) for duration in self.times[:-3]]
        tries += [(pair, -sense, duration) for duration in self.times[:-2]]
        tries += [(brake, 1.0, duration) for duration in self.times[3:]]
        response = _response(rows)
        for forces, sign, duration in tries:
            pushed = tuple(float(sign * force) for force in forces)
            if self._clear(rows[-1], np.array(pushed), duration, response):
                return pushed, duration
        return brake, self.times[-1]

    def _clear(self, row: Array, forces: Array, duration: float, response: Array) -> bool:
        """Whether both stay clear of the nets under forces, and if these then turn against the motion."""
        places, speeds = row[1:3].copy(), row[3:5].copy()
        room = np.maximum(self.room, np.abs(places) + 0.02)
        for number in range(round((duration + _STOP_S) / _STRIDE_S)):
            pushes = forces if number * _STRIDE_S < duration else -self.force * np.sign(speeds) * self._pushed
            signs = np.sign(speeds) * np.abs(response[:, 4])
            after = speeds + _STRIDE_S * (response[:, :4] @ [*(_MARGIN * pushes), *speeds])
            speeds = np.sign(after) * np.maximum(np.abs(after) - _STRIDE_S * np.abs(signs), 0.0)
            places = places + _STRIDE_S * speeds
            if np.any(np.abs(places) > room):
                return False
        return True

    @property
    def _pushed(self) -> Array:
        """1 for each body that can be pushed, 0 for the other."""
        return np.array([1.0, 0.0 if self.sealed else 1.0])


def _response(rows: Array) -> Array:
    """Change of the speed of both bodies per second and per unit of both forces, both speeds and dry friction."""
    (first, last), dt = (rows[:-1], rows[1:]), np.diff(rows[:, 0])
    found = list[Array]()
    for body in (0, 1):
        turned = signs(first[:, 3 + body], last[:, 3 + body], dt)
        ways = last[:, 1:3] - first[:, 1:3]
        table = np.column_stack([last[:, 5:] * dt[:, None], ways, -turned])
        prior = np.diag(_ROUGH / _USUAL)
        change = np.append(last[:, 3 + body] - first[:, 3 + body], np.zeros(5))
        found.append(cast(Array, np.linalg.lstsq(np.vstack([table, prior]), change, rcond=None)[0]))
    return np.array(found)
