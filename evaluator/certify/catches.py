"""Monitors the catches of a scene (latches, stops) under load: whether they hold and readings stay consistent.

A catch is a part of the apparatus that limits or stops a motion.
"""

import re
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from evaluator.answers.engine import Engine
from evaluator.certify.subject import Draw, Subject
from physment_mcp.contract.expressions import Compiled, ExpressionError
from physment_mcp.contract.formulas import Formulas
from scenes import Catch, Pack
from scenes.draw import evaluate

_WINDOW, _DISAGREEMENT, _FLOOR = 40, 0.5, 2e-3
"""Number of samples over which displacement and speed are compared; allowed relative and absolute error [m or rad]."""
_JUMPS = 2
"""Allowed number of sudden changes of speed in a window; their times between two samples are unknown."""
_PLACE, _MOTION, _HINGE = ("x", "y", "z"), ("vx", "vy", "vz", "wx", "wy", "wz"), ("angle", "spin")
_CAUGHT = "caught_"
_PARTS = re.compile(
    r"\b(?:(latch|net|rim|guard|pawl)(?:e?s)?|(?:an?|the|both|each) (catch)(?:es)?|(?:an?|the|soft|hard) (stop)s?)\b",
    re.IGNORECASE,
)
"""Pattern of nouns for a catch. One of its groups matches the noun."""
_ACTS = re.compile(r"\b(?:catch(?:es)?|caught|stops|for good)\b", re.IGNORECASE)
"""Words for the action of a catch."""
_OTHER_SENSES = re.compile(
    r"\b(?:com\w+|came|brought|bring\w*|slow\w*) to (?:a|the) stop\b|\bafter the stop\b"
    r"|\b(?:round|of) (?:its|the) rim\b",
    re.IGNORECASE,
)
"""Phrases in which these words describe a motion or a position on a wheel, and not a catch."""


def undeclared_catches(pack: Pack) -> list[str]:
    """Return the prompt's words for a latch, catch, net, rim, guard or stop that the pack does not declare.

    If a pack declares no catch, words for the action of a catch count too.
    """
    task = _OTHER_SENSES.sub("", pack.metadata.task)
    parts = dict.fromkeys(noun.lower() for match in _PARTS.finditer(task) for noun in match.groups() if noun)
    named = " ".join(word.lower() for catch in pack.catches for word in catch.words)
    acts = () if pack.catches else dict.fromkeys(match.group().lower() for match in _ACTS.finditer(task))
    return [*(noun for noun in parts if noun not in named), *(word for word in acts if word not in parts)]


def unknown_words(pack: Pack) -> list[str]:
    """Return the words of the pack's catches that do not occur in its prompt."""
    task = pack.metadata.task.lower()
    return [word for catch in pack.catches for word in catch.words if word.lower() not in task]


class _State:
    """The true state of bodies, by the variable names of laws, such as `object_1_vx`. Values are read on demand."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._of: dict[str, tuple[str, str]] = {}
        for body in engine.bodies:
            hinge = _HINGE if engine.turn(body) else ()
            self._of |= {f"{body}_{name}": (body, name) for name in (*_PLACE, *_MOTION, *hinge)}

    @property
    def names(self) -> tuple[str, ...]:
        """All names."""
        return ("t", *self._of)

    def values(self, names: Sequence[str]) -> dict[str, float]:
        """The present values of the given names."""
        return {name: self._value(name) for name in names}

    def _value(self, name: str) -> float:
        if name == "t":
            return self._engine.time
        body, quantity = self._of[name]
        if quantity in _PLACE:
            return float(self._engine.centre(body)[_PLACE.index(quantity)])
        if quantity in _MOTION:
            twist = self._engine.twist(body)
            return float([*twist.linear, *twist.angular][_MOTION.index(quantity)])
        turn = self._engine.turn(body)
        assert turn is not None
        return turn.angle if quantity == "angle" else turn.spin


@dataclass(frozen=True, slots=True)
class _Bound:
    """A bounded quantity of a catch."""

    text: str
    low: float
    high: float


class _Watched:
    """A catch in the laboratory of one seed, and the state in which it acted."""

    def __init__(self, catch: Catch, number: int, subject: Subject, draw: Draw, state: _State) -> None:
        self.catch, self._state = catch, state
        self._caught: dict[str, float] | None = None
        self._caught_at = 0.0
        field = f"catches.{number}.holds"
        knobs = {name: value for name, value in draw.knobs.items() if isinstance(value, int | float)}
        self._bounds = [
            _Bound(text, *(float(evaluate(subject.files, field, edge, draw.knobs)) for edge in edges))
            for text, edges in catch.holds.items()
        ]
        names = [*state.names, *(_CAUGHT + name for name in state.names)]
        self._sprung = _function(names, knobs, {f"{number}.sprung": catch.sprung or "1"})
        self._held = _function(names, knobs, {f"{number}.holds.{text}": text for text in catch.holds})
        wanted = {name.removeprefix(_CAUGHT) for _, arguments in (self._sprung, self._held) for name in arguments}
        self._wanted = sorted(wanted)

    @property
    def has_acted(self) -> bool:
        """Return whether the catch has acted; True for a catch that limits a quantity at all times."""
        return self._caught is not None

    def look(self) -> tuple[float, str | None]:
        """Sample the bounded quantities.

        Returns:
            The largest deviation, as a share of the allowed one; and a fault, or None.
        """
        now = self._state.values(self._wanted)
        if self._caught is None:
            if not _evaluated(self._sprung, now)[0]:
                return 0.0, None
            self._caught, self._caught_at = now, self._state.values(["t"])["t"]
        held_for = self._state.values(["t"])["t"] - self._caught_at
        if held_for < self.catch.within:
            return 0.0, None
        values = _evaluated(self._held, {**now, **{_CAUGHT + name: value for name, value in self._caught.items()}})
        worst = 0.0
        for bound, value in zip(self._bounds, values, strict=True):
            share = abs(value - (bound.low + bound.high) / 2) / ((bound.high - bound.low) / 2)
            if not share <= 1:
                span = f"{bound.low:g} to {bound.high:g}"
                what = f"{self.catch.words[0]} lets go: {bound.text} is {value:.4g}, not {span}, {held_for:g} s after"
                return share, what
            worst = max(worst, share)
        return worst, None


def _function(
    names: Sequence[str], knobs: Mapping[str, float], results: Mapping[str, str]
) -> tuple[Compiled, tuple[str, ...]]:
    """A compiled function and the names of its arguments."""
    text = " ".join(results.values())
    named = {name: value for name, value in knobs.items() if re.search(rf"\b{re.escape(name)}\b", text)}
    formulas = Formulas(names, named, {}, results)
    arguments = tuple(sorted(formulas.used))
    return formulas.function(arguments), arguments


def _evaluated(compiled: tuple[Compiled, tuple[str, ...]], values: Mapping[str, float]) -> tuple[float, ...]:
    function, arguments = compiled
    try:
        return function(*(values[name] for name in arguments))
    except (ArithmeticError, ValueError) as error:
        raise ExpressionError(f"an expression has no value in a state that was reached: {error}") from error


class _Consistency:
    """Compares the displacement of a body with its integrated speed over a window of samples."""

    def __init__(self) -> None:
        self._last: tuple[NDArray[np.float64], float] | None = None
        self._ways: deque[float] = deque(maxlen=_WINDOW)
        self._by_speed: deque[float] = deque(maxlen=_WINDOW)
        self._jumps: deque[float] = deque(maxlen=_WINDOW)

    def look(self, place: NDArray[np.float64], speed: float, duration_s: float) -> str | None:
        """Add a reading of position and speed; returns a fault, or None if they are consistent."""
        if not (np.isfinite(place).all() and np.isfinite(speed)):
            return "reads a number that is not finite"
        last, self._last = self._last, (place, speed)
        if last is None:
            return None
        self._ways.append(float(np.linalg.norm(place - last[0])))
        self._by_speed.append((speed + last[1]) / 2 * duration_s)
        self._jumps.append(abs(speed - last[1]) / 2 * duration_s)
        way, by_speed, unknown = sum(self._ways), sum(self._by_speed), _JUMPS * max(self._jumps) + _FLOOR
        if abs(way - by_speed) <= _DISAGREEMENT * max(way, by_speed) + unknown:
            return None
        span = len(self._ways) * duration_s
        return f"went {way:.3g} in {span:.3g} s by its places, and {by_speed:.3g} by its speeds"


class Watch:
    """Monitors all catches of a scene and the consistency of the readings of its objects."""

    def __init__(self, subject: Subject, draw: Draw, engine: Engine) -> None:
        """Start monitoring at the present state of the engine.

        Raises:
            ExpressionError: An expression of a catch is not allowed.
        """
        self._engine, self._then = engine, engine.time
        state = _State(engine)
        self.catches = [_Watched(catch, n, subject, draw, state) for n, catch in enumerate(subject.pack.catches)]
        self._objects = [f"object_{listed.object_id}" for listed in subject.pack.objects.values()]
        present = [body for body in self._objects if body in engine.bodies]
        self._moves = {body: _Consistency() for body in present if engine.is_movable(body)}
        self._turns = {body: _Consistency() for body in self._moves if engine.turn(body)}
        self.worst = 0.0
        """Largest share of its bounds that a quantity in `holds` has used up so far."""

    @property
    def acted(self) -> int:
        """Return the number of catches that have acted. Catches that limit a quantity at all times do not count."""
        return sum(watched.has_acted for watched in self.catches if watched.catch.sprung)

    def look(self) -> str | None:
        """Check the present state; returns a fault, or None."""
        duration, self._then = self._engine.time - self._then, self._engine.time
        for body, consistency in self._moves.items():
            speed = float(np.linalg.norm(self._engine.twist(body).linear))
            if fault := consistency.look(self._engine.centre(body), speed, duration):
                return f"{body} {fault} m"
        for body, consistency in self._turns.items():
            turn = self._engine.turn(body)
            assert turn is not None
            if fault := consistency.look(np.array([turn.angle]), abs(turn.spin), duration):
                return f"{body} {fault} rad"
        for catch in self.catches:
            share, fault = catch.look()
            self.worst = max(self.worst, share)
            if fault:
                return fault
        return None
