"""Grades a law that an agent states with its answer, by comparing its predictions with those of the laboratory's law.

Both laws are integrated with the same steps, initial states and loads (`law_motion`). Only the motion is compared and
not the expressions, so equivalent laws get the same grade. Neither the physics engine nor a language model is used.
"""

import hashlib
import json
import math
import random
from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any, NamedTuple

from evaluator.answers.law_motion import LEG_STEPS, LoadPlan, StatedMotion, held_steps
from evaluator.records.episode import Episode, LawGrade, Outcome
from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.contract.stated_laws import StatedLaw
from scenes.law_statements import Coordinate, LawModel

LAW_GRADER_VERSION = "3"
"""Version of these rules, stored with each grade of a law."""
EQUIVALENT = 0.05
"""Largest median error of the predicted motion at which a law can be equivalent, relative to the distance moved.

The median over the simulated motions hides an effect that occurs in few of them. An equivalent law must therefore also
depend on every quantity on which the true law depends (see `_dependences`).
"""
_COURSES = 20
"""Number of simulated motions that start in the region that the laboratory allows, and number that start outside it."""
_LEGS = 2
"""Number of legs of a simulated motion."""
_LEAST = 0.2
"""An error is divided by the extent of the motion, but at least by this share of the median extent of all motions."""
_PROBES, _CLAMPED_S = 24, 3.0
"""Number of random states at which dependences are tested, and shortest time of the clamping before them [s]."""
_INDEPENDENT, _DEPENDENT, _FELT = 0.005, 0.02, 0.01
"""Thresholds of the effect of a quantity on an acceleration, relative to the acceleration.

The true acceleration does not depend on a quantity with an effect below the first, and depends on one with an effect
above the second. In the stated law, an effect above the third counts as a dependence.
"""
_TURN = 3.0
"""Default radius of the region of positions, for objects that turn or have no stated limit [rad or m]."""
MAX_WORK = 400_000_000
"""Largest number of operations for grading a law: its length times the number of evaluations.

Only laws with state variables in laboratories with much more time than those of the suite need more.
"""
_LONG_S = 30.0
"""Default laboratory time for scenes that state no limit [s]."""


class TrueLaw(NamedTuple):
    """The law of a scene at a seed."""

    model: LawModel
    lab_time: float | None
    """Laboratory time of an episode [s]; None for no limit."""
    objects: tuple[str, ...]
    """Ids of the objects that an agent can name."""

    @property
    def motion(self) -> StatedMotion:
        """The equations of motion of the objects under this law."""
        return StatedMotion(StatedLaw(self.model.statement, self.objects), self.model.coordinates)


def stated_law(episode: Episode) -> Mapping[str, Any] | None:
    """Return `law` of the accepted answer, unchanged; None if it has none, or if there is no accepted answer."""
    if episode.outcome is not Outcome.ANSWERED:
        return None
    answers = (
        exchange.call.arguments
        for turn in episode.turns
        for exchange in turn.exchanges
        if exchange.call.tool == "answer" and exchange.returned and not exchange.is_error
    )
    found = next(answers, None)
    return None if found is None else found.get("law")


def grade_law(written: object, true: TrueLaw) -> LawGrade:
    """Grade a law. Never raises for any JSON value.

    `MAX_LENGTH`, the limit on the length of a law, and `MAX_WORK` limit the duration to seconds. Both limits count
    operations, so a grade does not depend on the speed of the machine.

    Args:
        written: The law as the agent wrote it.
        true: The law of the laboratory.
    """
    try:
        stated = StatedLaw(written, true.objects)
        _refuse_long_work(stated, true)
    except ExpressionError as error:
        return LawGrade(version=LAW_GRADER_VERSION, sha256=hash_of(written), equivalent=False, refused=str(error))
    own, other = true.motion, StatedMotion(stated, true.model.coordinates)
    dependence_f1, missed = _dependences(own, other, true)
    within, beyond = (_error(own, other, courses_of(true, far=far)) for far in (False, True))
    return LawGrade(
        version=LAW_GRADER_VERSION,
        sha256=hash_of(written),
        equivalent=max(within, beyond) <= EQUIVALENT and not missed,
        error_within=within if math.isfinite(within) else None,
        error_beyond=beyond if math.isfinite(beyond) else None,
        dependence_f1=dependence_f1,
        length=stated.length,
    )


def _refuse_long_work(law: StatedLaw, true: TrueLaw) -> None:
    """Refuse a law whose grading would take too many operations."""
    work = law.length * evaluations_of(true, has_states=bool(law.states))
    if work > MAX_WORK:
        raise ExpressionError(
            f"it cannot be compared: that takes {work / 1e6:.0f} million operations, and at most {MAX_WORK / 1e6:.0f}"
            " million are made"
        )


def evaluations_of(true: TrueLaw, *, has_states: bool) -> int:
    """Return the largest number of times that grading evaluates a law."""
    count = 2 * _COURSES * _LEGS * 4 * LEG_STEPS + _PROBES * (3 * len(true.model.coordinates) + 3)
    if not has_states:
        return count
    held = [course.held_s for far in (False, True) for course in courses_of(true, far=far)]
    variants = 3 * len(true.model.coordinates) + 2
    lab_time = true.lab_time or _LONG_S
    held += _PROBES * [*[_CLAMPED_S] * variants, _CLAMPED_S + lab_time]
    return count + 4 * sum(map(held_steps, held))


def hash_of(written: object) -> str:
    """Return a short hash of a law, by which a stored grade identifies the law."""
    return hashlib.sha256(json.dumps(written).encode()).hexdigest()[:16]


# Courses


def courses_of(true: TrueLaw, *, far: bool) -> list[LoadPlan]:
    """Return random plans of simulations that start in the region that the laboratory allows or, if `far`, outside it.

    They are the same for every law that an agent writes.
    """
    coordinates, radius = true.model.coordinates, true.model.radius or _TURN
    low, high = (1.0, 1.5) if far else (0.0, 0.8)
    swift, strong, late = (4.0, 8.0, 1.5) if far else (2.0, 3.0, 0.6)
    found: list[LoadPlan] = []
    for number in range(_COURSES):
        source = random.Random(f"course:{far}:{number}")  # noqa: S311 - reproducible, not secret
        held = late * (true.lab_time or _LONG_S) * source.random() if number % 2 else 0.0
        places = _vectors(source, coordinates, low * radius, high * radius)
        speeds = _vectors(source, coordinates, 0.0, swift)
        pushes = [_vectors(source, coordinates, 0.3, strong) for _ in range(_LEGS)]
        loads = [[a * one.inertia for a, one in zip(push, coordinates, strict=True)] for push in pushes]
        found.append(LoadPlan(held, places, speeds, loads))
    return found


def _vectors(source: random.Random, coordinates: Sequence[Coordinate], low: float, high: float) -> list[float]:
    """Return for each object the components of a vector of random direction and length."""
    found: list[float] = []
    for body in dict.fromkeys(one.body for one in coordinates):
        parts = [source.gauss() for one in coordinates if one.body == body]
        size = (low + (high - low) * source.random()) / max(math.hypot(*parts), 1e-9)
        found += [size * part for part in parts]
    return found


def _error(own: StatedMotion, other: StatedMotion, courses: Sequence[LoadPlan]) -> float:
    """Return the median error of a law's predicted motions, relative to their extent; infinite if none is finite."""
    true, stated = ([law.followed(course) for course in courses] for law in (own, other))
    pairs = [(a, b, course) for a, b, course in zip(true, stated, courses, strict=True) if a is not None]
    moved = [_spread(a, [[*course.places, *course.speeds]] * len(a)) for a, _, course in pairs]
    floor = tuple(_LEAST * median(parts) for parts in zip(*moved, strict=True))
    return median(
        math.inf
        if b is None
        else max(
            error / max(scale, least, 1e-9) for error, scale, least in zip(_spread(a, b), scales, floor, strict=True)
        )
        for (a, b, _), scales in zip(pairs, moved, strict=True)
    )


def _spread(first: Sequence[Sequence[float]], second: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Return the root mean square difference of the positions, and that of the velocities, of two motions."""
    half = len(first[0]) // 2

    def distance(part: slice) -> float:
        squares = [
            _squared(x - y) for a, b in zip(first, second, strict=True) for x, y in zip(a[part], b[part], strict=True)
        ]
        return math.sqrt(sum(squares) / len(first))

    return distance(slice(None, half)), distance(slice(half, None))


def _squared(value: float) -> float:
    """Return the square. Unlike `value ** 2`, it overflows to infinity and does not raise OverflowError."""
    return value * value


# Dependences


def _dependences(own: StatedMotion, other: StatedMotion, true: TrueLaw) -> tuple[float, int]:
    """Compare which quantities the accelerations of two laws depend on.

    The quantities are each position, velocity and load, the time, and the history before the present state.

    Returns:
        The F1 score of the pairs of an acceleration and a quantity, and the number of true dependences that are missed.
    """
    (found, scales), (stated, _) = _effects(own, true), _effects(other, true)
    hits = wrong = missed = 0
    for n, scale in enumerate(scales):
        for real, told in zip(found[n], stated[n], strict=True):
            if _INDEPENDENT * scale <= real < _DEPENDENT * scale:
                continue
            depends, felt = real >= _DEPENDENT * scale, told >= _FELT * scale
            hits += depends and felt
            wrong += felt and not depends
            missed += depends and not felt
    return 2 * hits / max(2 * hits + wrong + missed, 1), missed


def _effects(law: StatedMotion, true: TrueLaw) -> tuple[list[list[float]], list[float]]:
    """Return the root mean square of each acceleration, and of the effect of each quantity on it."""
    n, lab_time = len(true.model.coordinates), true.lab_time or _LONG_S
    squares = [[0.0] * (3 * n + 2) for _ in range(n)]
    sizes = [0.0] * n
    for number in range(_PROBES):
        source = random.Random(f"probe:{number}")  # noqa: S311 - reproducible, not secret
        present, changed, past, other_past = (_present(source, true) for _ in range(4))
        longer = _CLAMPED_S + source.random() * lab_time
        base = _acceleration(law, _CLAMPED_S, present, past[: 2 * n])
        variants = [
            _acceleration(law, _CLAMPED_S, [*present[:at], changed[at], *present[at + 1 :]], past[: 2 * n])
            for at in range(3 * n)
        ]
        variants.append(_acceleration(law, longer, present, past[: 2 * n]))
        variants.append(_acceleration(law, _CLAMPED_S, present, other_past[: 2 * n]))
        for at in range(n):
            sizes[at] += _squared(base[at]) / _PROBES
            for quantity, variant in enumerate(variants):
                squares[at][quantity] += _squared(variant[at] - base[at]) / _PROBES
    return [[math.sqrt(square) for square in row] for row in squares], [math.sqrt(size) for size in sizes]


def _present(source: random.Random, true: TrueLaw) -> list[float]:
    """Return random positions, velocities and loads within the limits of the laboratory."""
    coordinates = true.model.coordinates
    pushes = _vectors(source, coordinates, 0.3, 3.0)
    return [
        *_vectors(source, coordinates, 0.0, 0.8 * (true.model.radius or _TURN)),
        *_vectors(source, coordinates, 0.2, 2.0),
        *(a * one.inertia for a, one in zip(pushes, coordinates, strict=True)),
    ]


def _acceleration(law: StatedMotion, time: float, present: Sequence[float], past: Sequence[float]) -> list[float]:
    """Return the accelerations at a state after the objects were clamped at a past state; zeros if not finite."""
    split = 2 * len(law.coordinates)
    try:
        found, _ = law.rates(time, present[:split], law.clamped(past, time), present[split:])
    except (ArithmeticError, ValueError):
        found = [math.inf]
    return found if all(map(math.isfinite, found)) else [0.0] * len(law.coordinates)
