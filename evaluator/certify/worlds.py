"""What the engine says of a world: the answers to its questions, and its course against theory."""

import numpy as np
from scipy.optimize import brentq

from evaluator.answers.engine import Engine
from scenes.worlds.experiment import Array, simulated
from scenes.worlds.packs import StartState, mjcf_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import HARDEST, Question, option_of, value_of
from scenes.worlds.records import WorldRecord
from scenes.worlds.terms import Structure

_HELD = 1e12
"""Inertia by which bodies are held where they are [kg, kg·m²]."""


def engine_answers(record: WorldRecord, timestep: float | None = None) -> Array:
    """The answers by the engine, with the laws of the world and without a wall.

    Args:
        record: The world.
        timestep: Replaces the time step [s], to measure the discretisation error.
    """
    return np.array([_answer(record, question, timestep) for question in record.questions])


def course_gap(record: WorldRecord) -> float:
    """Greatest distance of the engine from theory in the certificate's course, in standard deviations of a reading."""
    structure = record.structure
    course = simulated(structure, record.constants, record.told, None, 0.01)
    engine, worst = Engine(mjcf_of(record)), 0.0
    for lasting, held, read in zip(course.durations, course.controls, course.readings, strict=True):
        _push(engine, record.apparatus, held)
        engine.step(engine.whole_steps(float(lasting)))
        worst = max(worst, float(np.abs((_seen(engine, structure) - read) / record.told.sigma).max()))
    return worst


def _answer(record: WorldRecord, question: Question, timestep: float | None) -> float:
    if question.options:
        return option_of(record.structure, question)
    if question.what != "push":
        return _ended(record, question, np.array(question.push), timestep)
    way = np.array(question.push)

    def beyond(force: float) -> float:
        return _ended(record, question, force * way, timestep)

    # That there is one such force is shown by theory, which tries many of them.
    return brentq(beyond, 0.0, HARDEST, xtol=1e-4) if beyond(0.0) < 0 < beyond(HARDEST) else float("nan")


def _ended(record: WorldRecord, question: Question, push: Array, timestep: float | None) -> float:
    """The asked number, with a push."""
    structure, width = record.structure, 2 if record.apparatus.flat else 1
    state = _at_release(record, question, timestep)
    engine = Engine(mjcf_of(record, walled=False, start=StartState(question.clock, tuple(state))), timestep)
    _push(engine, record.apparatus, push)
    engine.step(engine.whole_steps(question.lasting))
    return float(value_of(question, _seen(engine, structure), width))


def _at_release(record: WorldRecord, question: Question, timestep: float | None) -> Array:
    """The state in which the bodies are let go: what is hidden moves while they are held."""
    structure, width = record.structure, 2 if record.apparatus.flat else 1
    state = np.array(structure.start)
    rows = state[: structure.read].reshape(structure.bodies, 2, width)
    rows[:, 0] = np.array(question.place).reshape(structure.bodies, width)
    if question.clock and len(state) > structure.read:
        held = Engine(mjcf_of(record, walled=False, start=StartState(0.0, tuple(state))), timestep)
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
    """Places and velocities of what can be pushed."""
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
    """Places and velocities of hidden bodies, then the way."""
    axes, found = slice(0, 2 if structure.apparatus.flat else 1), list[float]()
    for at in structure.hidden:
        found += [*engine.centre(f"hidden_{at}")[axes], *engine.velocity(f"hidden_{at}")[axes]]
    if structure.worn:
        found += [engine.centre("odo")[2], engine.velocity("odo")[2]]
    return np.array(found)
