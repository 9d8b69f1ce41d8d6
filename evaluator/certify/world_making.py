"""Makes worlds and proves stored ones: acceptance by theory, then the engine's answers. Runs in worker processes."""

import hashlib
import os
import random
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial

import anyio
import numpy as np
from anyio import to_process

from evaluator.certify.parallel import in_processes
from evaluator.certify.worlds import course_gap, engine_answers
from scenes.errors import WorldError
from scenes.worlds.acceptance import IDENTIFIABLE, Maker, bounds_of
from scenes.worlds.levels import GRAMMAR, Difficulty
from scenes.worlds.orders import WorldOrder
from scenes.worlds.questions import answers, tolerance
from scenes.worlds.records import Certificate, WorldRecord

ENGINE_GAP = 0.05
"""Greatest distance of the engine's answers from the key, and of those at half the time step, in tolerances."""
_BOUND_GAP = 0.01
"""Greatest relative difference of the bounds on another machine: they are differences of nearly equal numbers."""
COURSE_GAP = 0.5
"""Greatest distance of the engine from theory in the certificate's course, in standard deviations of a reading."""


@dataclass(frozen=True, slots=True)
class Made:
    """A world that was accepted, and why draws before it were not."""

    record: WorldRecord
    certificate: Certificate
    refusals: Counter[str]


@dataclass(frozen=True, slots=True)
class Unmade:
    """A world of which no draw was accepted."""

    index: int
    reason: str


def make_world(level: int, difficulty: Difficulty, secret: str, index: int) -> Made:
    """The world of a level and an index.

    The draws are the same everywhere. Which of them is accepted depends on the last bits of numpy and LAPACK, so the
    record says what was accepted.

    Args:
        level: Its level, for the record.
        difficulty: What it has.
        secret: `PUBLIC`, or the text of a key.
        index: Its number, from 0.

    Raises:
        WorldError: No draw is accepted.
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
            half_step=_gaps(record, world.key, 0.0025),
            draws=sum(maker.refusals.values()) + 1,
        )
        fault = fault_of(record, certificate)
        if fault is None:
            return Made(record, certificate, maker.refusals)
        maker.refusals[fault] += 1


def fault_of(record: WorldRecord, certificate: Certificate) -> str | None:
    """What is wrong with a world; None if it is sound.

    Everything is computed again from the record: the key by theory, by the engine and at half the time step, the
    course, and the bounds. Not repeated are the tests by random numbers, which decided whether it was made.
    """
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
    "the engine gives another key": lambda record, proved: max(_gaps(record, proved.key, None)) > ENGINE_GAP,
    "half the time step gives another key": lambda record, proved: max(_gaps(record, proved.key, 0.0025)) > ENGINE_GAP,
    "the engine's course is not that of theory": lambda record, _: course_gap(record) > COURSE_GAP,
    "the readings give other bounds": _has_other_bounds,
    "not identifiable": lambda _, proved: max(proved.bounds) > IDENTIFIABLE,
}
"""What can be wrong with a world, in the order in which it is asked."""


def _gaps(record: WorldRecord, key: tuple[float, ...], timestep: float | None) -> tuple[float, ...]:
    """Distance of the engine's answers from the key, in tolerances."""
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
    """Make worlds in parallel processes; `on_made` gets each when it is ready, and also each that cannot be made.

    Raises:
        WorldError: No draw of the first one is accepted, so those of the others will hardly be.
    """
    # Inherited by the processes. The matrices are small: a second thread of OpenBLAS would only spin beside the first.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    limiter, some = anyio.CapacityLimiter(workers), False

    async def make_one(index: int) -> None:
        nonlocal some
        work = partial(make_world, level, difficulty, secret, index)
        try:
            found: Made | Unmade = await to_process.run_sync(work, cancellable=True, limiter=limiter)
            some = True
        except WorldError as error:
            if not some:
                raise
            found = Unmade(index, str(error))
        on_made(found)

    async with anyio.create_task_group() as tasks:
        for index in indexes:
            tasks.start_soon(make_one, index)


async def faults_of(
    worlds: Iterable[tuple[WorldRecord, Certificate]],
    workers: int,
    on_checked: Callable[[WorldRecord, str | None], None],
) -> None:
    """Prove stored worlds in parallel processes; `on_checked` gets each with its fault, None if it is sound."""
    await in_processes(
        worlds, lambda world: partial(fault_of, *world), workers, lambda world, found: on_checked(world[0], found)
    )
