"""The equations of motion of a structure in numpy, compiled from the expressions of its laws.

Constants and states may be arrays with a value for each trial, because a step takes as long for one as for hundreds.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes import integration
from scenes.worlds.law_texts import ODO_RATE, WALL, swapped
from scenes.worlds.parts import Apparatus
from scenes.worlds.terms import Structure

Array = NDArray[np.float64]
Rates = Callable[[Mapping[str, Any], Any, Any, Any], Any]
"""Time derivative of a state from constants, time [s], state and controls; all may be arrays of trials."""

_SCOPE = {name: getattr(np, name) for name in ("sqrt", "sin", "cos", "exp", "tanh", "maximum", "empty_like")}
_SINGLE = {name: getattr(math, name) for name in ("sqrt", "sin", "cos", "exp", "tanh")} | {
    "maximum": max,
    "empty_like": list,
}
"""Functions for a single trial in Python floats, because calls of numpy functions on scalars are slow."""


@functools.lru_cache(4096)
def rates_of(structure: Structure, *, walled: bool, held: bool = False, single: bool = False) -> Rates:
    """Compile the time derivative of the state to one function.

    Args:
        structure: The terms of the law.
        walled: Whether the soft wall acts.
        held: Whether visible bodies are fixed while hidden bodies move.
        single: Whether states are lists of floats, for `followed`, instead of arrays.
    """
    writer = _Writer(structure)
    if not held:  # what is held moves by no term
        writer.terms()
    if walled and not held:
        writer.walls()
    writer.seen(held=held)
    writer.unseen()
    scope: dict[str, Any] = {**(_SINGLE if single else _SCOPE), "pi": math.pi}
    # Nothing but texts of `scenes.worlds` is executed.
    exec("\n".join(["def rates(K, t, S, F):", *writer.lines, " return out"]), scope)  # noqa: S102 - as just said
    return scope["rates"]


class _Writer:
    """Generates the source of the function line by line."""

    def __init__(self, structure: Structure) -> None:
        self.structure = structure
        flat = structure.apparatus.flat
        self.places, self.speeds, self.pushes = (
            (("x", "y"), ("vx", "vy"), ("px", "py")) if flat else (("q",), ("u",), ("pq",))
        )
        self.bodies = range(1, structure.bodies + 1)
        self.sums = {(body, axis): [f"{push}{body}"] for body in self.bodies for axis, push in enumerate(self.pushes)}
        """Summands of each acceleration."""
        self.row = 0
        self.lines = [f" {name}=K[{name!r}]" for name in structure.ranges]
        self.lines += [f" {','.join(structure.states)},=S", " out=empty_like(S)"]
        for body in self.bodies:
            for axis, push in enumerate(self.pushes):
                control = (body - 1) * len(self.pushes) + axis
                self.lines.append(f" {push}{body}=F[{control}]/{_mass(body)}")

    def names(self, body: int) -> dict[str, str]:
        """Local name → variable of the function."""
        own = (*self.places, *self.speeds)
        names = {name: f"b{body}_{name}" for name in own} | {push: f"{push}{body}" for push in self.pushes}
        return names | {f"o_{name}": f"b{3 - body}_{name}" for name in own if self.structure.bodies == 2}

    def terms(self) -> None:
        """Write the acceleration of each body by each term."""
        for at, term in enumerate(self.structure.terms):
            let, force, factors = term.written(at)
            for body in self.bodies:
                if not self.structure.acts_on(term, body):
                    continue
                names = self.names(body) | {name: f"{name}_{at}_{body}" for name in let}
                self.lines += [f" {names[name]}={swapped(text, names)}" for name, text in let.items()]
                gain = "*".join(f"({swapped(text, names)})" for text in factors) or "1.0"
                self.lines.append(f" G{at}_{body}={gain}")
                for axis, text in enumerate(force):
                    part = f"A{at}_{body}_{axis}"
                    self.lines.append(f" {part}=G{at}_{body}*({swapped(text, names)})")
                    self.sums[body, axis].append(part)
                    if term.kind.reaction:
                        self.sums[2, axis].append(f"(-m/m2*{part})")

    def walls(self) -> None:
        """Write the acceleration by the soft wall or the buffers."""
        edge = repr(self.structure.radius)
        for body in self.bodies:
            if self.structure.apparatus is Apparatus.GLIDER:
                back = f"maximum(b1_q-{edge},0.0)-maximum(-b1_q-{edge},0.0)"
                self.sums[1, 0].append(f"(-{WALL!r}/m*({back}))")
            elif self.structure.apparatus.flat:
                far = f"sqrt(b{body}_x**2+b{body}_y**2+1e-12)"
                self.lines.append(f" W{body}={WALL!r}/{_mass(body)}*maximum(1-{edge}/{far},0.0)")
                for axis, name in enumerate(self.places):
                    self.sums[body, axis].append(f"(-W{body}*b{body}_{name})")

    def seen(self, *, held: bool) -> None:
        """Write the time derivative of the readable states."""
        for body in self.bodies:
            sums = ["+".join(self.sums[body, axis]) for axis in range(len(self.places))]
            self._rows([f"b{body}_{speed}" for speed in self.speeds], sums, zero=held)

    def unseen(self) -> None:
        """Write the time derivative of the hidden bodies and of the path length."""
        for at in self.structure.hidden:
            texts = self.structure.terms[at].hidden_at(at)
            self._rows([f"h{at}_{speed}" for speed in self.speeds], [swapped(t, self.names(1)) for t in texts])
        if self.structure.worn:
            speed = "+".join(f"b1_{speed}**2" for speed in self.speeds)
            self._rows(["odo_v"], [f"{ODO_RATE!r}*(sqrt({speed}+1e-6)-odo_v)"])

    def _rows(self, speeds: list[str], accelerations: list[str], *, zero: bool = False) -> None:
        for text in (*speeds, *accelerations):
            self.lines.append(f" out[{self.row}]={'0.0' if zero else text}")
            self.row += 1


def _mass(body: int) -> str:
    return "m" if body == 1 else "m2"


def moved(
    rates: Rates, constants: Mapping[str, Any], time: Any, state: Array, controls: Any, lasting: Any, longest_s: float
) -> Array:
    """Return the state after constant controls for a duration.

    Args:
        rates: The equations of motion.
        constants: Numbers, or arrays of trials.
        time: Initial time [s].
        state: Shape (states, trials).
        controls: Forces and torques [N, N·m]; a row for each control.
        lasting: Duration [s]; a number, or an array of trials.
        longest_s: Longest step of the integration [s].
    """

    def at(now: Any, seen: Array) -> Array:
        return rates(constants, now, seen, controls)

    return integration.advanced(at, time, state, lasting, longest_s)


def followed(
    rates: Rates,
    constants: Mapping[str, float],
    time: float,
    state: list[float],
    controls: Sequence[float],
    lasting: float,
    longest_s: float,
) -> list[float]:
    """Integrate one trial in Python floats, ten times faster than `moved`; NaN where the law is undefined."""
    count = max(1, math.ceil(lasting / longest_s))
    h = lasting / count
    half, sixth = h / 2, h / 6
    try:
        for _ in range(count):
            a = rates(constants, time, state, controls)
            b = rates(constants, time + half, [s + half * r for s, r in zip(state, a, strict=True)], controls)
            c = rates(constants, time + half, [s + half * r for s, r in zip(state, b, strict=True)], controls)
            d = rates(constants, time + h, [s + h * r for s, r in zip(state, c, strict=True)], controls)
            state = [s + sixth * (p + 2 * q + 2 * r + u) for s, p, q, r, u in zip(state, a, b, c, d, strict=True)]
            time += h
    except (ArithmeticError, ValueError):
        return [math.nan] * len(state)
    return state
