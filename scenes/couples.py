"""A family of laws of two joined bodies: every structure fitted to what `scenes.pairs` reads, and its steady speeds."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, cast

import numpy as np
from scipy.optimize import brentq

from scenes import family
from scenes.courses import Array
from scenes.pairs import BODIES, Windows, joint_misfits, ratios, refined_constants, robust, slides
from scenes.protocol import AnswerValue, Member

_PARTS = {"f2": "s2", "c2": "x2", "q2": "q2"}
"""Part of the resistance of the second body → the column of the intervals that it goes with."""
_STARTS, _SWITCH, _FIXED = 2, 1e-6, 0.01
"""Starts that are refined; smallest resistance per speed with which steady speeds are computed, and the one that stands
for any where readings leave it open [N·s/m]."""


@dataclass(frozen=True, slots=True)
class Couple:
    """A family of laws of two joined bodies: kinds of joints, and of what resists the second body.

    The first body is resisted by c1 v and by the dry friction f1. Labels of structures are such as `rigid, linear`.
    """

    laws: Mapping[str, Sequence[str]]
    """Resistance of the second body → its parts: f2 (constant) [N], c2 (times v) [N·s/m], q2 (times v|v|)."""
    box: Mapping[str, tuple[float, float]]
    """Ranges of n, m1, m2, c1, f1, f2, c2, q2, and of `share` and `fluid`: see `power`."""
    sigma: float
    """Standard deviation of a difference of two readings [m, m/s]."""
    forces: tuple[float, float]
    """Forces on both at which a clutch surely slips from rest [N]."""

    @property
    def structures(self) -> dict[str, list[str]]:
        """Label of each structure → names of its constants.

        With a fluid and a resistance that are both linear, motions and steady speeds tell c2 and n not apart: n times
        k, the fluid's force per slip over k, and c1 and c2 with the rest give the same. So c2 is not fitted there.
        """
        more = {"rigid": (), "clutch": ("share",), "fluid": ("fluid",)}
        return {
            f"{kind}, {law}": ["n", "m1", "m2", "c1", "f1", *(p for p in parts if kind + p != "fluidc2"), *more[kind]]
            for kind, (law, parts) in product(more, self.laws.items())
        }

    def _named(self, structure: str, constants: Array) -> dict[str, float]:
        return {"c2": _FIXED} | dict(zip(self.structures[structure], constants.tolist(), strict=True))

    def power(self, kind: str, knobs: Mapping[str, Any]) -> float:
        """Greatest force of a clutch, which is a share of what a rigid joint would pass on; force per slip of a fluid.

        The rigid joint is that of bodies which `forces` set in motion, with their dry friction against both.
        """
        if kind != "clutch":
            return float(knobs.get("fluid", 0.0))
        n, m1, m2, (first, second) = knobs["n"], knobs["m1"], knobs["m2"], self.forces
        first, second = first - knobs["f1"], -second + (1 if second == 0 else -1) * knobs.get("f2", 0.0)
        return float(knobs["share"] * (n * m2 * first + m1 * second) / (m1 + n**2 * m2))

    def misfits(self, structure: str, constants: Array, win: Windows) -> Array:
        """Misfits of the balance of both bodies and of what the joint passes on, in standard deviations."""
        kind, law = structure.split(", ")
        knobs = self._named(structure, constants)
        n, m1, m2, c1, f1 = (knobs[name] for name in ("n", "m1", "m2", "c1", "f1"))
        loss = sum(knobs[part] * win[_PARTS[part]] for part in self.laws[law])
        f2, q2 = knobs.get("f2", 0.0), knobs.get("q2", 0.0)
        turns, unsure = win["turns"] * win["dt"], win["rests"] * 1e3 * ("f2" in knobs)
        per_way = knobs["c2"] + 2 * q2 * np.maximum(abs(win["v2"]), abs(win["w2"]))
        taken, power = m2 * win["d2"] + loss - win["G"], self.power(kind, knobs)
        both = m1 * win["d1"] + c1 * win["x1"] + f1 * win["s1"] + n * taken - win["F"]
        second = np.hypot(self.sigma * np.hypot(m2, per_way), np.hypot(q2 * win["e2"], win["pauses"] * win["dt"] * f2))
        first = np.hypot(self.sigma * np.hypot(m1, c1), turns * f1)
        found = [both / np.hypot(first, n * second) / (1 + unsure)]
        found += joint_misfits(kind, n, power, taken, second, {**win, "rests": unsure > 0}, self.sigma)
        return np.clip(np.concatenate(found), -300, 300)

    def _start(self, structure: str, win: Windows, ratio: float) -> Array:
        """Constants by steps: how the second body answers to force and slip, then the balance of both."""
        kind, law = structure.split(", ")
        own = np.column_stack([win[_PARTS[part]] for part in self.laws[law]])
        rough = np.hypot(self.sigma, win["turns"] * win["dt"] * 0.4 + 0.0005 * abs(win["F"]))
        used, shares, power = ~win["rests"], np.full(own.shape[1], 0.4), 2.0
        if kind == "fluid":
            table = np.column_stack([-own, win["G"], win["x1"], -win["x2"]])[used]
            *found, _, pulled, power = robust(table, win["d2"][used], rough[used])
            shares, ratio = np.array(found), float(np.clip(pulled / (power or 1.0), 0.2, 4.5))
        elif kind == "clutch" and (used & slides(ratio, win, self.sigma)).sum() > own.shape[1] + 1:
            used = used & slides(ratio, win, self.sigma)
            way = np.sign(ratio * win["v1"] - win["v2"]) * win["dt"]
            *found, _, power = robust(np.column_stack([-own, win["G"], way])[used], win["d2"][used], rough[used])
            shares = np.array(found)
        both = [win["d1"], win["x1"], win["s1"]]
        right, size = win["F"] + ratio * win["G"], 2 * rough
        if kind == "rigid":
            m1, c1, f1, m2, *parts = robust(
                np.column_stack([*both, ratio * win["d2"], *(ratio * own.T)]), right, size
            ).tolist()
        else:
            table = np.column_stack([*both, ratio * (win["d2"] + own @ shares)])
            m1, c1, f1, m2 = robust(table, right, size).tolist()
            parts = (shares * m2).tolist()
        knobs = {"n": ratio, "m1": m1, "m2": m2, "c1": c1, "f1": f1, **dict(zip(self.laws[law], parts, strict=True))}
        knobs = {name: float(np.clip(value, *self.box[name])) for name, value in knobs.items()}
        full = self.power("clutch", {**knobs, "share": 1.0})
        knobs |= {"share": power * m2 / full, "fluid": power * m2}
        low, high = self._bounds(structure)
        found = np.nan_to_num([knobs[name] for name in self.structures[structure]], nan=1.0)
        return np.clip(found, low + 1e-6, high - 1e-6)

    def _bounds(self, structure: str) -> tuple[Array, Array]:
        low, high = np.array([self.box[name] for name in self.structures[structure]]).T
        return low, high

    def fitted(self, structure: str, win: Windows) -> Array:
        """The constants of a structure that fit best."""

        def misfits(constants: Array) -> Array:
            return self.misfits(structure, constants, win)

        kind = structure.split(", ", maxsplit=1)[0]
        tried = [self._start(structure, win, n) for n in ratios(kind, win, self.sigma)]
        tried.sort(key=lambda start: float(np.sum(np.minimum(misfits(start) ** 2, 400))))
        low, high = self._bounds(structure)
        return refined_constants(misfits, tried[:_STARTS], low, high, keeps_ratio=kind == "clutch")[1]

    def members(self, win: Windows, predict: Callable[[str, Mapping[str, float]], AnswerValue]) -> dict[str, Member]:
        """Every structure, fitted to the intervals."""
        return {structure: self.member(structure, win, predict) for structure in self.structures}

    def member(
        self, structure: str, win: Windows, predict: Callable[[str, Mapping[str, float]], AnswerValue]
    ) -> Member:
        """A structure, fitted to the intervals."""
        return family.member(
            lambda constants: self.misfits(structure, constants, win),
            lambda constants: predict(structure, self._named(structure, constants)),
            self.fitted(structure, win),
            [self.box[name] for name in self.structures[structure]],
        )

    def steady(
        self, structure: str, knobs: Mapping[str, Any], forces: tuple[float, float], brake: float
    ) -> list[float]:
        """Speeds of both in the end, under steady forces [N] and with a further dry friction on the second body [N]."""
        kind, n = structure.split(", ", maxsplit=1)[0], float(knobs["n"])
        power, first = self.power(kind, knobs), (float(knobs["f1"]), float(knobs["c1"]), 0.0)
        parts = {
            "f2": 0.0,
            "c2": 0.0,
            "q2": 0.0,
            **{name: float(knobs[name]) for name in self.laws[structure.split(", ")[1]]},
        }
        second = parts["f2"] + brake, max(parts["c2"], _SWITCH), parts["q2"]

        def speeds(passed: float) -> tuple[float, float]:
            return _speed(forces[0] - n * passed, *first), _speed(forces[1] + passed, *second)

        def slip(passed: float) -> float:
            own, other = speeds(passed)
            return n * own - other

        if kind == "clutch" and slip(power) * slip(-power) > 0:
            return list(speeds(math.copysign(power, slip(power))))
        least = 500.0 if kind != "clutch" else power
        excess = (lambda passed: slip(passed) - passed / power) if kind == "fluid" else slip
        return list(speeds(float(cast(float, brentq(excess, -least, least, xtol=1e-13, rtol=1e-14)))))


def _speed(force: float, dry: float, linear: float, square: float) -> float:
    """Steady speed under a force against dry friction and linear v + square v²."""
    rest = max(abs(force) - dry, 0.0)
    speed = 2 * rest / (linear + math.sqrt(linear**2 + 4 * square * rest)) if rest else 0.0
    return math.copysign(speed, force)


def off_steady(
    engine: Any, speeds: Sequence[float], forces: Sequence[float], off: float, seconds: float
) -> list[float]:
    """Speeds a while after both were set off by this share of steady speeds, under steady forces."""
    for body, force, speed in zip(BODIES, forces, speeds, strict=True):
        engine.set_velocity(body, np.array([(1 + off) * speed, 0.0, 0.0]))
        engine.push(body, force=np.array([force, 0.0, 0.0]))
    engine.step(engine.whole_steps(seconds))
    return [float(engine.twist(body).linear[0]) for body in BODIES]
