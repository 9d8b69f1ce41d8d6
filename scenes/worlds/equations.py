"""The equations of motion of a structure in numpy, compiled from the expressions of its laws.

Constants and states may be arrays with a value for each trial, because a step takes as long for one as for hundreds.
"""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.fitting import advanced
from scenes.worlds.law_texts import ODO_RATE, WALL, swapped
from scenes.worlds.parts import Apparatus
from scenes.worlds.straight_line import Program
from scenes.worlds.terms import Structure

Array = NDArray[np.float64]
Rate = Callable[[Any, Any], Any]
"""Time derivative of a state from time [s] and state; both may be arrays of trials."""
Rates = Callable[[Mapping[str, Any], Any], Rate]
"""The rate for constants and controls; both may be arrays of trials."""

_SCOPE = {name: getattr(np, name) for name in ("sqrt", "sin", "cos", "exp", "tanh", "maximum", "empty_like", "where")}
_SINGLE = {name: getattr(math, name) for name in ("sqrt", "sin", "cos", "exp", "tanh")} | {"maximum": max}
"""Functions for a single trial in Python floats, because calls of numpy functions on scalars are slow."""


@functools.lru_cache(4096)
def rates_of(
    structure: Structure, *, walled: bool, held: bool = False, single: bool = False, switched: bool = False
) -> Rates:
    """Compile the time derivative of the state to one function.

    Args:
        structure: The terms of the law.
        walled: Whether the soft wall acts.
        held: Whether visible bodies are fixed while hidden bodies move.
        single: Whether states are lists of floats, for `followed`, instead of arrays.
        switched: Whether each part has an additional constant (see `switch_of`) that switches it on and off.
    """
    writer = _Writer(structure, switched=switched)
    if not held:  # a body that is held has no acceleration
        writer.terms()
    if walled and not held:
        writer.walls()
    writer.seen(held=held)
    writer.unseen()
    return _compiled(writer, writer.rows, single=single)


@functools.lru_cache(256)
def hidden_rates_of(structure: Structure) -> Rates:
    """Compile the accelerations of the hidden bodies to a function that returns a list of arrays.

    The function accepts a list of arrays as the state.
    """
    writer = _Writer(structure)
    writer.unseen()
    width = 2 if structure.apparatus.flat else 1
    hidden = writer.rows[: 2 * width * len(structure.hidden)]  # the derivative of the path length follows them
    rows = [row for at in range(width, len(hidden), 2 * width) for row in hidden[at : at + width]]
    return _compiled(writer, rows, single=True, scope=_SCOPE)


def switch_of(part: tuple[int, int | None]) -> str:
    """Return the name of the constant that switches a part on and off."""
    at, number = part
    return f"on{at}" if number is None else f"on{at}m{number}"


def _compiled(writer: "_Writer", rows: list[str], *, single: bool, scope: Mapping[str, Any] | None = None) -> Rates:
    """Compile generated lines to a function that returns time derivatives.

    Args:
        writer: The object that generated the lines.
        rows: Variables or numbers that the function returns.
        single: Whether the function computes with Python floats instead of arrays.
        scope: Additional names that the lines may use.
    """
    lines = ["def rates(K, F):", *(f" {line}" for line in writer.program.early), " def rate(t, S):"]
    lines += [f"  {','.join(writer.structure.states)},=S", *(f"  {line}" for line in writer.program.late)]
    if single:
        lines.append(f"  return [{','.join(rows)}]")
    else:
        lines += ["  out=empty_like(S)", *(f"  out[{at}]={row}" for at, row in enumerate(rows)), "  return out"]
    names: dict[str, Any] = {**(scope or (_SINGLE if single else _SCOPE)), "pi": math.pi}
    # Only text from `scenes.worlds` is compiled, never text from a user.
    exec("\n".join([*lines, " return rate"]), names)  # noqa: S102 - see the comment above
    return names["rates"]


class _Writer:
    """Generates the operations of the function."""

    def __init__(self, structure: Structure, *, switched: bool = False) -> None:
        self.structure, self.switched = structure, switched
        flat = structure.apparatus.flat
        self.places, self.speeds, self.pushes = (
            (("x", "y"), ("vx", "vy"), ("px", "py")) if flat else (("q",), ("u",), ("pq",))
        )
        self.bodies = range(1, structure.bodies + 1)
        self.sums = {(body, axis): [f"{push}{body}"] for body in self.bodies for axis, push in enumerate(self.pushes)}
        """Summands of each acceleration."""
        self.rows: list[str] = []
        """Variable or number of each time derivative, in the order of the states."""
        self.program = Program(("t", *structure.states))
        for name in (*structure.ranges, *(switch_of(part) for part in structure.parts if switched)):
            self.program.let(name, f"K[{name!r}]")

    def names(self, body: int) -> dict[str, str]:
        """Local name → variable of the function."""
        own = (*self.places, *self.speeds)
        names = {name: f"b{body}_{name}" for name in own} | {push: f"{push}{body}" for push in self.pushes}
        return names | {f"o_{name}": f"b{3 - body}_{name}" for name in own if self.structure.bodies == 2}

    def terms(self) -> None:
        """Generate the acceleration of each body as a sum over the applied force and the terms."""
        for body in self.bodies:
            for axis, push in enumerate(self.pushes):
                control = (body - 1) * len(self.pushes) + axis
                self.program.let(f"{push}{body}", f"F[{control}]/{_mass(body)}")
        for at, term in enumerate(self.structure.terms):
            let, force, factors = term.written(at)
            if self.switched:
                factors = tuple(f"where({switch_of((at, n))},{text},1.0)" for n, text in enumerate(factors))
            for body in self.bodies:
                if not self.structure.acts_on(term, body):
                    continue
                names = self.names(body) | {name: f"{name}_{at}_{body}" for name in let}
                for name, text in let.items():
                    self.program.let(names[name], swapped(text, names))
                gain = "*".join(f"({swapped(text, names)})" for text in factors)
                for axis, text in enumerate(force):
                    part, own = f"A{at}_{body}_{axis}", swapped(text, names)
                    own = f"({gain})*({own})" if gain else own
                    self.program.let(part, f"where({switch_of((at, None))},{own},0.0)" if self.switched else own)
                    self.sums[body, axis].append(part)
                    if term.kind.reaction:
                        self.sums[2, axis].append(f"(-m/m2*{part})")

    def walls(self) -> None:
        """Generate the acceleration by the soft wall or the buffers."""
        edge = repr(self.structure.radius)
        for body in self.bodies:
            if self.structure.apparatus is Apparatus.GLIDER:
                back = f"maximum(b1_q-{edge},0.0)-maximum(-b1_q-{edge},0.0)"
                self.sums[1, 0].append(f"(-{WALL!r}/m*({back}))")
            elif self.structure.apparatus.flat:
                far = f"sqrt(b{body}_x**2+b{body}_y**2+1e-12)"
                self.program.let(f"W{body}", f"{WALL!r}/{_mass(body)}*maximum(1-{edge}/{far},0.0)")
                for axis, name in enumerate(self.places):
                    self.sums[body, axis].append(f"(-W{body}*b{body}_{name})")

    def seen(self, *, held: bool) -> None:
        """Generate the time derivatives of the readable states."""
        for body in self.bodies:
            sums = ["+".join(self.sums[body, axis]) for axis in range(len(self.places))]
            rows = [*(f"b{body}_{speed}" for speed in self.speeds), *sums]
            self._rows(["0.0"] * len(rows) if held else rows)

    def unseen(self) -> None:
        """Generate the time derivatives of the states of hidden bodies and of the path length."""
        for at in self.structure.hidden:
            texts = self.structure.terms[at].hidden_at(at)
            self._rows([*(f"h{at}_{speed}" for speed in self.speeds), *(swapped(t, self.names(1)) for t in texts)])
        if self.structure.worn:
            speed = "+".join(f"b1_{speed}**2" for speed in self.speeds)
            self._rows(["odo_v", f"{ODO_RATE!r}*(sqrt({speed}+1e-6)-odo_v)"])

    def _rows(self, texts: list[str]) -> None:
        self.rows += [self.program.value(text) for text in texts]


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
    return advanced(rates(constants, controls), time, state, lasting, longest_s)


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
        rate = rates(constants, controls)
        for _ in range(count):
            a = rate(time, state)
            b = rate(time + half, [s + half * r for s, r in zip(state, a, strict=True)])
            c = rate(time + half, [s + half * r for s, r in zip(state, b, strict=True)])
            d = rate(time + h, [s + h * r for s, r in zip(state, c, strict=True)])
            state = [s + sixth * (p + 2 * q + 2 * r + u) for s, p, q, r, u in zip(state, a, b, c, d, strict=True)]
            time += h
    except (ArithmeticError, ValueError):
        return [math.nan] * len(state)
    return state
