"""Makes worlds, verifies stored ones and computes their answers with the engine, in worker processes."""

import hashlib
import random
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import root_scalar

from evaluator.answers.engine import Engine
from evaluator.certify.processes import in_processes
from scenes import WorldError
from scenes.worlds.acceptance import IDENTIFIABLE, Maker, bounds_of
from scenes.worlds.answering import answers
from scenes.worlds.experiment import Array, simulated
from scenes.worlds.levels import GRAMMAR, Difficulty
from scenes.worlds.orders import WorldOrder
from scenes.worlds.packs import TIMESTEP_S, StartState, mjcf_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question, option_of, tolerance, value_of
from scenes.worlds.records import Certificate, WorldRecord
from scenes.worlds.terms import Structure

_ROUGH_S = 0.03
"""Largest time step of the numerical integration that gives an initial guess of the force in question [s]."""
_BESIDE = 1.02
"""Second guess of the force, as a multiple of the first; the secant method needs two."""
_FORCE_TOL = 1e-4
"""Difference of successive forces at which the search stops [N, N·m]."""
_HELD_STEPS = 4
"""Time step while bodies are held, as a multiple of the usual one.

Hidden bodies then move smoothly and for a long time.
"""
_HELD = 1e12
"""Inertia that keeps bodies at rest until they are released [kg, kg·m²]."""


def engine_answers(record: WorldRecord, timestep: float | None = None) -> Array:
    """Compute the answers with the engine, with the laws of the world but without the wall that bounds its laboratory.

    Args:
        record: The world.
        timestep: Time step to use in place of the model's [s], to measure the discretisation error.
    """
    return np.array([_answer(record, question, timestep) for question in record.questions])


def course_gap(record: WorldRecord) -> float:
    """Return the largest difference of engine and theory under the certificate's pushes [standard deviations]."""
    structure = record.structure
    course = simulated(structure, record.constants, record.told, None, 0.01)
    true = course.readings - record.told.errors_at(record.constants, np.cumsum(course.durations))
    engine, worst = Engine(mjcf_of(record)), 0.0
    for lasting, held, seen in zip(course.durations, course.controls, true, strict=True):
        _push(engine, record.apparatus, held)
        engine.step(engine.whole_steps(float(lasting)))
        worst = max(worst, float(np.abs((_seen(engine, structure) - seen) / record.told.sigma).max()))
    return worst


def _answer(record: WorldRecord, question: Question, timestep: float | None) -> float:
    if question.options:
        return option_of(record.structure, question)
    if question.what != "push":
        return _ended(record, question, np.array(question.push), timestep)
    way = np.array(question.push)

    def beyond(force: float) -> float:
        return _ended(record, question, force * way, timestep)

    # Theory, which tries many forces, shows that the force is unique. The search with the engine starts from it.
    begin = float(answers(record.structure, record.constants, [question], _ROUGH_S)[0, 0])
    if np.isnan(begin):
        return begin
    found = root_scalar(beyond, x0=begin, x1=_BESIDE * begin, xtol=_FORCE_TOL)
    return float(found.root) if found.converged else float("nan")


def _ended(record: WorldRecord, question: Question, push: Array, timestep: float | None) -> float:
    """Simulate a world under a force and return the quantity for which the question states a target."""
    structure, width = record.structure, 2 if record.apparatus.flat else 1
    state = _at_release(record, question, timestep)
    engine = Engine(
        mjcf_of(record, walled=False, padded=False, start=StartState(question.clock, tuple(state))), timestep
    )
    _push(engine, record.apparatus, push)
    engine.step(engine.whole_steps(question.lasting))
    return float(value_of(question, _seen(engine, structure), width))


def _at_release(record: WorldRecord, question: Question, timestep: float | None) -> Array:
    """Return the state at which the bodies are released. Hidden bodies move while the others are held."""
    structure, width = record.structure, 2 if record.apparatus.flat else 1
    state = np.array(structure.start)
    rows = state[: structure.read].reshape(structure.bodies, 2, width)
    rows[:, 0] = np.array(question.place).reshape(structure.bodies, width)
    if question.clock and len(state) > structure.read:
        longer = _HELD_STEPS * (timestep or TIMESTEP_S)
        held = Engine(mjcf_of(record, walled=False, padded=False, start=StartState(0.0, tuple(state))), longer)
        joints = ["hinge"] if record.apparatus is Apparatus.WHEEL else list("xy"[:width])
        bodies = range(1, structure.bodies + 1)
        held = held.changed({f"joint[object_{body}_{joint}].armature": _HELD for body in bodies for joint in joints})
        held.step(held.whole_steps(question.clock))
        state[structure.read :] = _hidden(held, structure)
    rows[:, 1] = np.array(question.speed).reshape(structure.bodies, width)
    return state


def _push(engine: Engine, apparatus: Apparatus, held: Array) -> None:
    if apparatus is Apparatus.WHEEL:
        engine.push("object_1", torque=np.array([0.0, 0.0, held[0]]))
        return
    for body, part in enumerate(held.reshape(-1, 2 if apparatus.flat else 1), start=1):
        engine.push(f"object_{body}", force=np.array([*part, 0.0, 0.0])[:3])


def _seen(engine: Engine, structure: Structure) -> Array:
    """Return positions and velocities of the bodies that can be pushed."""
    found: list[float] = []
    for body in (f"object_{number}" for number in range(1, structure.bodies + 1)):
        hinge = engine.turn(body)
        if hinge is not None:
            found += [hinge.angle, hinge.spin]
        else:
            axes = slice(0, 2 if structure.apparatus.flat else 1)
            found += [*engine.centre(body)[axes], *engine.velocity(body)[axes]]
    return np.array(found)


def _hidden(engine: Engine, structure: Structure) -> Array:
    """Return positions and velocities of the hidden bodies in the engine, then those of the odometer if any."""
    axes, found = slice(0, 2 if structure.apparatus.flat else 1), list[float]()
    for at in structure.hidden:
        found += [*engine.centre(f"hidden_{at}")[axes], *engine.velocity(f"hidden_{at}")[axes]]
    if structure.worn:
        found += [engine.centre("odo")[2], engine.velocity("odo")[2]]
    return np.array(found)


_HALF_STEP_S = 0.0025
ENGINE_GAP = 0.05
"""Largest distance of the engine's answers from the key, also at half the time step [tolerances]."""
_BOUND_GAP = 0.01
"""Largest relative difference of the bounds between machines. It is not 0 because of cancellation."""
COURSE_GAP = 0.5
"""Largest difference of engine and theory under the certificate's pushes [standard deviations of a reading]."""


@dataclass(frozen=True, slots=True)
class Made:
    """An accepted world, and the reasons why earlier samples were rejected."""

    record: WorldRecord
    certificate: Certificate
    refusals: Counter[str]


@dataclass(frozen=True, slots=True)
class Unmade:
    """The index for which no sampled world was accepted, and the reasons."""

    index: int
    reason: str


def make_world(level: int, difficulty: Difficulty, secret: str, index: int) -> Made:
    """Make the world of a level and an index.

    The sampled worlds are the same on every machine. Which one is accepted may depend on rounding in numpy and LAPACK,
    so the record contains the accepted world.

    Args:
        level: Level of the world, for the record.
        difficulty: Attributes of the world.
        secret: `PUBLIC`, or the text of a key.
        index: Number of the world, from 0.

    Raises:
        WorldError: No sampled world is accepted.
    """
    stream = f"{GRAMMAR}:{secret}:{level}:{index}"
    order = WorldOrder(level, difficulty, secret)
    split = order.split_at(index)
    maker = Maker(difficulty, random.Random(stream), split)  # noqa: S311 - documented to be the same everywhere
    salt = hashlib.sha256(f"{stream}:salt".encode()).hexdigest()[:16]
    drawn = {"settings": order.settings, "commitment": order.commitment}
    while True:
        world = maker.world()
        record = WorldRecord.of(world, level, index, split, salt, **drawn)
        certificate = Certificate(
            index=index,
            record=record.digest,
            key=world.key,
            bounds=world.bounds,
            engine=_gaps(record, world.key, None),
            half_step=_gaps(record, world.key, _HALF_STEP_S),
            draws=sum(maker.refusals.values()) + 1,
        )
        fault = _fault(record, certificate)
        if fault is None:
            return Made(record, certificate, maker.refusals)
        maker.refusals[fault] += 1


def fault_of(record: WorldRecord, certificate: Certificate) -> str | None:
    """Verify a world; returns its fault, or None if it is sound.

    The key (by theory, by the engine and at half the time step), the motion under the certificate's pushes, and the
    bounds are computed again from the record. The randomised tests by which the world was accepted are not repeated.
    """
    gaps = {"engine": _gaps(record, certificate.key, None), "half_step": _gaps(record, certificate.key, _HALF_STEP_S)}
    return _fault(record, certificate.model_copy(update=gaps))


def _fault(record: WorldRecord, certificate: Certificate) -> str | None:
    """Return the fault of a world, given its certificate with recomputed values; None if it is sound."""
    return next((fault for fault, is_wrong in _FAULTS.items() if is_wrong(record, certificate)), None)


def _has_other_theory(record: WorldRecord, certificate: Certificate) -> bool:
    theory = answers(record.structure, record.constants, record.questions, 0.01)[:, 0]
    return not np.allclose(theory, certificate.key, rtol=1e-5, atol=1e-5)


def _has_other_bounds(record: WorldRecord, certificate: Certificate) -> bool:
    bounds = bounds_of(record.structure, record.constants, record.told, record.questions)
    return not np.allclose(bounds, certificate.bounds, rtol=_BOUND_GAP)


_FAULTS: Mapping[str, Callable[[WorldRecord, Certificate], bool]] = {
    "the certificate is that of another record": lambda record, proved: proved.record != record.digest,
    "theory gives another key": _has_other_theory,
    "the engine gives another key": lambda _, proved: max(proved.engine) > ENGINE_GAP,
    "half the time step gives another key": lambda _, proved: max(proved.half_step) > ENGINE_GAP,
    "the engine's course is not that of theory": lambda record, _: course_gap(record) > COURSE_GAP,
    "the readings give other bounds": _has_other_bounds,
    "not identifiable": lambda _, proved: max(proved.bounds) > IDENTIFIABLE,
}
"""Fault → predicate that detects it, in the order of checking."""


def _gaps(record: WorldRecord, key: tuple[float, ...], timestep: float | None) -> tuple[float, ...]:
    """Return the distances of the engine's answers from the key [tolerances]."""
    wanted = np.array(key)
    found = np.abs(engine_answers(record, timestep) - wanted) / tolerance(wanted)
    return tuple(float(f"{gap:.3g}") for gap in np.where(np.isfinite(found), found, 1e9))


async def make_worlds(
    level: int,
    difficulty: Difficulty,
    secret: str,
    indexes: Iterable[int],
    workers: int,
    on_made: Callable[[Made | Unmade], None],
) -> None:
    """Make worlds in parallel processes; `on_made` is called with each world, or with each that cannot be made.

    Raises:
        WorldError: No sample for the first world is accepted, so the others are unlikely to succeed.
    """
    some = False

    def done(_: int, found: Made | Unmade) -> None:
        nonlocal some
        some = some or isinstance(found, Made)
        if isinstance(found, Unmade) and not some:
            raise WorldError(found.reason)
        on_made(found)

    await in_processes(indexes, lambda index: partial(_made, level, difficulty, secret, index), workers, done)


def _made(level: int, difficulty: Difficulty, secret: str, index: int) -> Made | Unmade:
    """Make a world in a worker process."""
    try:
        return make_world(level, difficulty, secret, index)
    except WorldError as error:
        return Unmade(index, str(error))


async def faults_of(
    worlds: Iterable[tuple[WorldRecord, Certificate]],
    workers: int,
    on_checked: Callable[[WorldRecord, str | None], None],
) -> None:
    """Verify stored worlds in parallel processes; `on_checked` is called with each and its fault, None if sound."""
    await in_processes(
        worlds, lambda world: partial(fault_of, *world), workers, lambda world, found: on_checked(world[0], found)
    )
