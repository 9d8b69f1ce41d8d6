"""Two bodies that something joins: what is passed on between them, from impulses. For reference protocols.

Over an interval the momentum of each body changes by the impulse of all that acts. With speeds and places at both ends,
the integrals of v, sign(v) and v|v| follow, so that the balance of each body is linear in masses, resistances and gear
ratio n. What the second body takes beyond its own balance, the joint passes on. Its law, against the slip n v1 - v2, is
`rigid` (no slip), `clutch` (a greatest force) or `fluid` (in proportion to the slip).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from scenes.courses import Array
from scenes.protocol import Call, Exchanges, call

BODIES = ("object_1", "object_2")
Windows = Mapping[str, Array]
"""Columns of the intervals: duration `dt`; impulses `F`, `G` of the forces on both; changes of speed `d1`, `d2`; ways
`x1`, `x2`; `s1`, `s2` integrals of sign(v); `q2` integral of v2|v2|; `v1`, `v2` first and `w1`, `w2` last speeds;
`rests` where the second body rests; `turns`, the share in which a body may have turned round or stopped."""


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


def signs(first: Array, last: Array, duration: Array) -> Array:
    """Integral of the sign of a speed that changes evenly."""
    return duration * (abs(last) - abs(first)) / np.where(abs(last - first) > 1e-9, last - first, 1.0) * (
        first * last < 0
    ) + duration * np.sign(first + last) * (first * last >= 0)


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
    middle = (6 * way2 / dt - v2 - w2) / 4
    square = dt * (v2 * abs(v2) + 4 * middle * abs(middle) + w2 * abs(w2)) / 6
    win = {"F": force * dt, "G": other * dt, "dt": dt, "d1": w1 - v1, "d2": w2 - v2, "x1": y1 - x1, "x2": way2}
    win |= {"s1": signs(v1, w1, dt), "s2": signs(v2, w2, dt), "q2": square, "v1": v1, "w1": w1, "v2": v2, "w2": w2}
    win["rests"] = abs(way2) < still
    stops = np.minimum(abs(w1), abs(w2)) < still
    win["turns"] = 0.15 * ((v1 * w1 < 0) | (v2 * w2 < 0)) + 0.5 * stops
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
    mixed = (slip[0] * slip[1] < 0) | (abs(slip[0]) < tolerance) | (abs(slip[1]) < tolerance)
    error = np.hypot(error, mixed * 0.5 * power * win["dt"])
    return [np.where(stuck, way / sigma / 4, (taken - passed) / error / (1 + unsure))]


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
