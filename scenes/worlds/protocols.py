"""Reference protocols for worlds, which push the bodies, fit a law and predict the answers.

`informed_protocol` uses the structure of a world but not its constants. It shows that a world can be solved within its
limits. `blind_protocol` uses only the prompt and the grammar.
"""

from collections.abc import Callable, Generator, Mapping
from threading import Event

import numpy as np

from scenes.course_record import Course
from scenes.fitting import Array
from scenes.protocol import Call, Protocol, Reading, answer, call, with_law
from scenes.worlds.answering import answers
from scenes.worlds.course_fits import on_course
from scenes.worlds.experiment import LOOK_S, LOOKS, SEARCH_S, Excitation, Situation
from scenes.worlds.packs import law_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.predictions import Prediction, predicted
from scenes.worlds.records import WorldRecord
from scenes.worlds.refits import constants_of
from scenes.worlds.search import Search
from scenes.worlds.task_reading import questions_of, situation_of
from scenes.worlds.terms import Structure
from scenes.worlds.weak_form import Legs

_SEED = 5
"""Seed of the pushes, which differs from the certificate's."""
_ASKS_FOR_LAW = "In the argument `law` of `answer`"
"""Words of the opening prompt of a scene in which a law may be stated with the answer."""
SEARCH_SECONDS = 120.0
"""Processor time of the search for the terms [s]."""


def informed_protocol(record: WorldRecord, prompt: str) -> Protocol:
    """Return the reference protocol of a world, which uses its structure but not its constants."""
    course, structure = (yield from _explored(record.told)), record.structure
    fit = on_course(course, record.told, Search(Legs.of(course, record.told)).solve(structure), SEARCH_S)
    constants = constants_of(fit)
    found = np.nan_to_num(answers(structure, constants, record.questions, 0.02)[:, 0])
    yield [_answered(prompt, found, structure, constants)]


def blind_protocol(
    prompt: str,
    seconds: float = SEARCH_SECONDS,
    on_predicted: Callable[[Prediction], None] | None = None,
    halted: Event | None = None,
) -> Protocol:
    """Return the reference protocol that knows only the grammar and the prompt, not the structure.

    Args:
        prompt: The opening prompt of a world.
        seconds: Processor time of the search [s].
        on_predicted: Callback with the prediction, before the answer is sent.
        halted: Event by which another thread stops the search; the answer is then that of the best law so far.

    Raises:
        WorldError: The prompt is not that of a world, or has a question that cannot be parsed.
    """
    told, asked = situation_of(prompt), questions_of(prompt)
    course = yield from _explored(told)
    prediction = predicted(Search(Legs.of(course, told), seconds=seconds, halted=halted or Event()), asked)
    if on_predicted is not None:
        on_predicted(prediction)
    yield [_answered(prompt, prediction.answer, *prediction.law)]


def _answered(prompt: str, found: Array, structure: Structure, constants: Mapping[str, float]) -> Call:
    """Return the call with the answer, and with the law if the prompt asks for one."""
    answered = answer([float(f"{number:.6g}") for number in found])
    return with_law(answered, law_of(structure, constants) if _ASKS_FOR_LAW in prompt else None)


def _explored(told: Situation) -> Generator[list[Call], list[Reading], Course]:
    """Apply pushes until the limits of the laboratory are reached; returns pushes and readings."""
    plan = Excitation(told, _SEED)
    bare = Structure(told.apparatus, (), told.radius)
    read, held, seen = np.array(bare.start)[: bare.read], list[Array](), list[Array]()
    for legs in told.turns:
        pushes = plan.pushes(read, legs)
        readings = yield [one for push in pushes for one in _leg(told, push)]
        looks = _looks(told, readings)
        held += [push for push in pushes for _ in range(LOOKS)]
        seen += looks
        read = looks[-1]
    return Course(np.full(len(seen), LOOK_S), np.array(held), np.array(seen))


def _leg(told: Situation, push: Array) -> list[Call]:
    """Return the calls of a leg: pushes, then readings."""
    bodies = [f"object_{body}" for body in range(1, told.bodies + 1)]
    if told.apparatus is Apparatus.WHEEL:
        calls = [call("apply_torque", object_id=bodies[0], torque_vector=[0.0, 0.0, float(push[0])])]
    else:
        parts = push.reshape(len(bodies), -1)
        calls = [
            call("apply_force", object_id=body, force_vector=[*map(float, part), 0.0, 0.0][:3])
            for body, part in zip(bodies, parts, strict=True)
        ]
    reads = [call(tool, object_id=body) for body in bodies for tool in ("get_position", "get_velocity")]
    return calls + [one for _ in range(LOOKS) for one in (call("step", duration=LOOK_S), *reads)]


def _looks(told: Situation, readings: list[Reading]) -> list[Array]:
    """Return the values of each reading, in the order of the state."""
    bodies, width = told.bodies, 2 if told.apparatus.flat else 1
    names = ("angle", "angular_velocity") if told.apparatus is Apparatus.WHEEL else ("position", "velocity")
    pairs = [reading for reading in readings if "position" in reading or "velocity" in reading]
    numbers = [
        np.atleast_1d(np.asarray(reading[names[number % 2]], float))[:width] for number, reading in enumerate(pairs)
    ]
    return [np.concatenate(numbers[at : at + 2 * bodies]) for at in range(0, len(numbers), 2 * bodies)]
