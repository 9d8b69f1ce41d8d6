"""Generates random questions, chooses those of a world, and computes the answers of naive shortcuts."""

import random
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, compress

import numpy as np
from numpy.typing import NDArray

from scenes.fitting import Array
from scenes.worlds.answering import answers
from scenes.worlds.drawing import options_with
from scenes.worlds.experiment import Situation
from scenes.worlds.levels import Difficulty, kinds_for
from scenes.worlds.questions import Question
from scenes.worlds.terms import Structure

Flags = NDArray[np.bool_]

LATEST_S = 10.0
"""Largest delay of a late question after the end of the laboratory time [s]."""
OPTIONS = 4
"""Number of options of a `which` question."""
_CANDIDATES, _KINDS = 60, 3
"""Number of drawn questions, and of their kinds."""
_MOST = {"which": 1, "push": 4}
"""Largest number of candidates of some kinds: `which` questions have one form, and `push` questions take most time."""
_FLAT = ("dx", "dy", "vx", "vy", "speed")
_LINE = ("dq", "u")
_WEAKEST, _STRONGEST = 1.05, 1.4
"""Smallest force of a `push` question as a multiple of the limit, and largest one as a multiple of the usual force."""
_LEAST_SIZE = 0.5
"""Smallest distance of a `push` question [m, rad]."""


def drawn(
    structure: Structure,
    constants: Mapping[str, float],
    told: Situation,
    difficulty: Difficulty,
    rng: random.Random,
) -> list[Question]:
    """Generate random candidate questions of kinds that the difficulty allows and the apparatus supports.

    Args:
        structure: The terms of the law.
        constants: Their constants, from which the target of a `push` question is computed.
        told: Apparatus, limits and instruments of the laboratory.
        difficulty: The difficulty, which names the kinds of questions.
        rng: The random stream.
    """
    kinds = kinds_for(told.apparatus, difficulty.kinds)
    kinds = rng.sample(kinds, min(len(kinds), _KINDS))
    found: list[Question] = []
    plain = [kind for kind in kinds if kind not in _MOST] or ["push"]
    for number in range(_CANDIDATES):
        kind = kinds[number % len(kinds)]
        if number >= len(kinds) * _MOST.get(kind, _CANDIDATES):
            kind = plain[number % len(plain)]
        if kind == "which":
            found.append(_which(structure, rng))
        elif kind == "push":
            found.append(_push(structure, constants, told, difficulty, rng))
        else:
            found.append(_question(structure, told, difficulty, kind, rng))
    return found


def _way(width: int, size: float, rng: random.Random) -> list[float]:
    """A vector of a given length in a random direction."""
    if width == 1:
        return [round(size * rng.choice((-1, 1)), 2)]
    turn = rng.uniform(0, 2 * np.pi)
    return [round(size * float(np.cos(turn)), 2), round(size * float(np.sin(turn)), 2)]


def _question(structure: Structure, told: Situation, difficulty: Difficulty, kind: str, rng: random.Random) -> Question:
    width, bodies = 2 if told.apparatus.flat else 1, structure.bodies
    situation = rng.choice(("strong", "late")) if kind == "apart" else kind
    place = [number for _ in range(bodies) for number in _way(width, rng.uniform(0.5, 0.6 * told.radius), rng)]
    speed, push, clock = [0.0] * width * bodies, [0.0] * width * bodies, 0.0
    first = slice(0, width)
    strong = difficulty.strong
    if situation == "strong":
        place[first] = _way(width, rng.uniform(0.0, 0.4 * told.radius), rng)
        push[first] = _way(width, told.force * rng.uniform(0.8 * strong, 1.2 * strong), rng)
    elif situation == "far":
        place[first] = _way(width, told.radius + rng.uniform(1.2, 2.8), rng)
        push[first] = _way(width, told.force * rng.uniform(0.0, 0.8), rng)
    else:
        clock = float(np.ceil(told.looks * 0.45) + LATEST_S)
        speed[first] = _way(width, rng.uniform(3.5, 6.0), rng)
        push[first] = _way(width, told.force * rng.uniform(0.0, 0.8), rng)
    what = "apart" if kind == "apart" else rng.choice(_FLAT if told.apparatus.flat else _LINE)
    return Question(
        kind, tuple(place), tuple(speed), tuple(push), clock, rng.choice((1.5, 2.0, 2.5)), what, rng.randint(1, bodies)
    )


def _push(
    structure: Structure,
    constants: Mapping[str, float],
    told: Situation,
    difficulty: Difficulty,
    rng: random.Random,
) -> Question:
    """Generate a random `push` question. Its answer is a force above the limit of the laboratory."""
    situation = _question(structure, told, difficulty, "strong", rng)
    width = 2 if told.apparatus.flat else 1
    way = [0.0] * len(situation.push)
    way[rng.randrange(width)] = rng.choice((-1.0, 1.0))
    asked = replace(situation, kind="push", push=tuple(way), what="push", body=1)
    # The range of answers must be wide: the middle of a narrow range would be a good guess.
    force = told.force * _WEAKEST * (_STRONGEST * difficulty.strong / _WEAKEST) ** rng.random()
    reached = _reached(structure, constants, asked, force)
    return replace(asked, size=round(reached, 2) if reached > _LEAST_SIZE else _LEAST_SIZE)  # also if it is NaN


def _reached(structure: Structure, constants: Mapping[str, float], asked: Question, force: float) -> float:
    """Return the distance by which a force moves the body of a `push` question."""
    axis = next(axis for axis, part in enumerate(asked.push) if part)
    what = ("dx", "dy")[axis] if structure.apparatus.flat else "dq"
    held = replace(asked, what=what, push=tuple(force * part for part in asked.push))
    return asked.push[axis] * float(answers(structure, constants, [held], 0.03)[0, 0])


def _which(structure: Structure, rng: random.Random) -> Question:
    nothing = (0.0,) * structure.controls
    asked = rng.choice(structure.terms).form
    options = options_with(structure, asked, OPTIONS, rng)
    return Question("which", nothing, nothing, nothing, 0.0, 0.0, "which", options=options)


def covering(asked: Sequence[Question], matter: Flags, spread: Array, count: int) -> tuple[int, ...] | None:
    """Return indices of `count` questions such that each part of the law affects one of them; None if there are none.

    Of all such sets it is one with the most kinds of questions, and among those the one in which the largest standard
    error is smallest.

    Args:
        asked: Candidates.
        matter: For each part and candidate, whether the part affects a determined answer, shape (parts, candidates).
        spread: Smallest possible standard error of each answer, in tolerances, shape (candidates,).
        count: Number of questions.
    """
    sets = list(combinations(map(int, np.flatnonzero(matter.any(axis=0))), count))
    affected: Flags = matter[:, np.array(sets, dtype=np.intp).reshape(-1, count)].max(axis=2)
    covers: Flags = affected.min(axis=0)
    return min(
        compress(sets, covers),
        key=lambda chosen: (-len({asked[number].kind for number in chosen}), spread[list(chosen)].max()),
        default=None,
    )


def nearby(
    structure: Structure, constants: Mapping[str, float], asked: Sequence[Question], told: Situation
) -> dict[str, Array]:
    """Return the answers in the nearest allowed situation: as measured there, and scaled in proportion to the force.

    The answer to a `which` question is NaN, because no single situation answers it.
    """
    nearest: list[float] = []
    scaled: list[float] = []
    for question in asked:
        if question.options:
            nearest.append(np.nan)
            scaled.append(np.nan)
        elif question.what == "push":
            nearest.append(told.force)
            scaled.append(told.force * question.size / _reached(structure, constants, question, told.force))
        else:
            found = float(answers(structure, constants, [_staged(question, told)], 0.03)[0, 0])
            nearest.append(found)
            scaled.append(found * max(1.0, float(np.linalg.norm(question.push)) / told.force))
    return {
        "those in the nearest allowed situation": np.array(nearest),
        "those scaled from the nearest allowed situation": np.array(scaled),
    }


def _staged(asked: Question, told: Situation) -> Question:
    """Return the nearest situation that the laboratory allows."""
    strength, far = float(np.linalg.norm(asked.push)), float(np.linalg.norm(asked.place))
    push = tuple(part * min(1.0, told.force / max(strength, 1e-9)) for part in asked.push)
    place = tuple(part * min(1.0, told.radius / max(far, 1e-9)) for part in asked.place)
    speed = tuple(part * 0.5 for part in asked.speed)
    return replace(asked, push=push, place=place, speed=speed, clock=0.0)
