"""Samples worlds and accepts those that pass the certificates that need no engine.

A sampled world is accepted if every part of its law affects an answer, a fit to its readings can converge, the readings
determine its answers, and no answer can be found without experiments. Constants of a part without effect are sampled
again; if that does not help, a new world is sampled.
"""

import random
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scenes.errors import WorldError
from scenes.fitting import Array
from scenes.worlds.answering import answers, answers_without_parts, gradients
from scenes.worlds.asking import Flags, covering, drawn, nearby
from scenes.worlds.candidates import Fit
from scenes.worlds.course_fits import on_course
from scenes.worlds.drawing import draw_constants, draw_structure
from scenes.worlds.experiment import SEARCH_S, Situation, laws_of_fit, on_unit, retraced, simulated
from scenes.worlds.instrument_errors import draw_errors
from scenes.worlds.levels import Difficulty
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question, tolerance
from scenes.worlds.refits import Refits, constants_of, units_of
from scenes.worlds.rivals import mistakable, removable, rival_of
from scenes.worlds.search import Search
from scenes.worlds.terms import Structure
from scenes.worlds.weak_form import Legs

FORCE = 5.0
"""Largest force [N] or torque [N·m], the same in every world, so that the limit does not reveal the mass."""
ASKED = 3
"""Number of questions of a world."""
MATTERS = 3.0
"""Smallest change of an answer when a part is removed, in tolerances."""
IDENTIFIABLE = 0.35
"""Largest allowed standard error of an answer, in tolerances."""
_LEAST_LOOKS, _MOST_NOISE = 12, 0.05
_QUICK_S, _CHOICE_S, _FINE_S = 0.12, 0.06, 0.01
"""Longest integration steps [s] in three uses: testing candidates, choosing questions, and computing keys."""
_REDRAWN = 8
_SENSITIVE = 1.0
"""Largest root mean square of the differences between the course integrated with two step sizes, in standard deviations
of the readings."""
_REFIT_SEED, _SOLVE_SEED = 1, 2
"""Noise seeds of the readings to which other structures are fitted, and of the readings that the reference solves."""
_BESIDE = 0.05
"""Initial offset of the reference's fit from the drawn constants, as a share of their ranges."""
_SHIFT = 1e-4
_SHARPER_LOOKS, _SHARPER_NOISE = 1.4, 1.7
"""Factors of the number of readings and of the noise if the readings do not exclude a rival."""


@dataclass(frozen=True, slots=True)
class DrawnWorld:
    """A world with its questions and their answers."""

    structure: Structure
    constants: Mapping[str, float]
    told: Situation
    questions: tuple[Question, ...]
    key: tuple[float, ...]
    bounds: tuple[float, ...]
    """Smallest possible standard error of each answer, given the certificate's readings, in tolerances."""


class Refused(Exception):
    """A sampled world failed a certificate; the message is the reason."""


@dataclass(slots=True)
class Maker:
    """Samples worlds of one difficulty from a random stream until one is accepted."""

    difficulty: Difficulty
    rng: random.Random
    split: str | None = None
    """Required split of the world's structure; None for any."""
    refusals: Counter[str] = field(default_factory=Counter[str])
    """Number of refused draws by reason."""

    def world(self, most: int = 2000) -> DrawnWorld:
        """Return the first sampled world that is accepted.

        Raises:
            WorldError: No sampled world was accepted within the limit of attempts.
        """
        for _ in range(most):
            try:
                with np.errstate(all="ignore"):
                    return self._drawn()
            except Refused as refusal:
                self.refusals[str(refusal)] += 1
            except np.linalg.LinAlgError:
                self.refusals["singular"] += 1
        reasons = ", ".join(f"{why} {count}" for why, count in self.refusals.most_common(3))
        raise WorldError(f"none of {most} draws was accepted ({reasons}); ask for fewer parts or more readings")

    def _drawn(self) -> DrawnWorld:
        structure = draw_structure(self.difficulty, self.rng, self.split)
        own = self.difficulty
        told = Situation(structure.apparatus, structure.radius, FORCE, own.looks, own.noise, own.bias, own.drift)
        constants = draw_constants(structure, self.rng)
        if told.errors:
            constants |= draw_errors(told.width, told.bias, told.drift, self.rng)
        _refuse_wild(
            structure, constants, told
        )  # checked first, because it is the most frequent reason and the cheapest to detect
        asked, before = drawn(structure, constants, told, self.difficulty, self.rng), dict(constants)
        matter, key = self._repaired(structure, constants, asked)
        if constants != before:
            _refuse_wild(structure, constants, told)
        worth = np.flatnonzero(matter.any(axis=0) & _sane(key))
        if len(worth) < ASKED:
            raise Refused("too few questions depend on the law")
        asked, matter = [asked[number] for number in worth], matter[:, worth]
        information = _Information(structure, constants, told, asked, _CHOICE_S)
        spread = information.spread(told.looks)
        chosen = covering(asked, matter & (spread < IDENTIFIABLE), spread, ASKED)
        if chosen is None:
            raise Refused("no three questions that the readings determine depend on every term")
        told = information.tightened(self.difficulty.bound, list(chosen))
        questions = tuple(asked[number] for number in chosen)
        bounds = _Information(structure, constants, told, questions).spread(told.looks)
        if bounds.max() > IDENTIFIABLE:
            raise Refused("the readings do not determine the answers")
        final = answers(structure, constants, questions, _FINE_S)[:, 0]
        world = DrawnWorld(structure, constants, told, questions, _numbers(final), _numbers(bounds))
        _refuse_guessable(world, self.rng)
        refits = _refits(world)
        _refuse_useless(world, refits)
        world, refits = _determined(world, refits, self.difficulty)
        if removable(refits, world.questions, np.array(world.key)):
            raise Refused("the answers are right without the error of the instrument")
        _refuse_unsolved(world, self.rng)
        _refuse_mistakable(world, refits, self.rng)
        return world

    def _repaired(
        self, structure: Structure, constants: dict[str, float], asked: Sequence[Question]
    ) -> tuple[Flags, Array]:
        """Sample the constants of parts without effect again; returns which questions each part affects."""
        for _ in range(_REDRAWN):
            found = answers_without_parts(structure, constants, asked, _QUICK_S)
            key, matter = found[:, 0], _matters(found[:, 0], found[:, 1:])
            useless = [part for part, row in zip(structure.parts, matter, strict=True) if not (row & _sane(key)).any()]
            if not useless:
                return matter, key
            marks = [f"{at}" if number is None else f"{at}m{number}" for at, number in useless]
            names = [name for name in structure.ranges for mark in marks if _is_of(name, mark)]
            constants |= draw_constants(structure, self.rng, names)
        raise Refused("a term of the law changes too little")


def _is_of(name: str, mark: str) -> bool:
    """Return whether the name of a constant ends with the indices of a part: those of its term and modulation."""
    return name.endswith(mark) and name.removesuffix(mark).isalpha()


def _numbers(found: Array) -> tuple[float, ...]:
    return tuple(float(f"{number:.6g}") for number in found)


def _sane(key: Array) -> Flags:
    return np.isfinite(key) & (np.abs(key) > 0.25) & (np.abs(key) < 60)


def _less(
    structure: Structure, constants: Mapping[str, float], part: tuple[int, int | None]
) -> tuple[Structure, dict[str, float]]:
    """Return the structure without a part, and its constants.

    Names of constants contain the index of their term, so those of later terms change.
    """
    fewer, renamed = structure.without(*part)
    return fewer, {new: value for name, value in constants.items() if (new := renamed(name)) is not None}


def _matters(key: Array, without: Array) -> Flags:
    """Return, for each part and question, whether removing the part changes the answer; constants are not refitted."""
    return (np.abs(_finite(without) - key[:, None]) > MATTERS * tolerance(key)[:, None]).T


def _refuse_wild(structure: Structure, constants: Mapping[str, float], told: Situation) -> None:
    """Refuse a world whose motion leaves the floor or is sensitive to small errors: a fit to it would not converge."""
    course = simulated(structure, constants, told, None)
    if not np.isfinite(course.readings).all():
        raise Refused("the object leaves the floor")
    if told.apparatus is not Apparatus.WHEEL:
        true = course.readings - told.errors_at(constants, np.cumsum(course.durations))
        places = true.reshape(len(true), told.bodies, 2, told.width)[:, :, 0]
        if (np.linalg.norm(places, axis=2) > told.radius).mean() > 0.15:
            raise Refused("the object leaves the floor")
    if float(np.sqrt((retraced(structure, constants, told, course) ** 2).mean())) > _SENSITIVE:
        raise Refused("the motion is too sensitive to small errors")


class _Information:
    """Computes the smallest standard errors of answers that an experiment allows. Source: Cramér-Rao bound."""

    def __init__(
        self,
        structure: Structure,
        constants: Mapping[str, float],
        told: Situation,
        asked: Sequence[Question],
        longest_s: float = 0.03,
    ) -> None:
        laws, course = laws_of_fit(structure, told), simulated(structure, constants, told, None)
        unit = on_unit(laws, constants)
        around = np.column_stack([unit[:, None], unit[:, None] + _SHIFT * np.eye(len(unit))])
        misfits = laws.misfits(course, structure.label, around, by_legs=False)
        self._told, self._course = told, course
        self._slope: Array = (misfits[:, 1:] - misfits[:, :1]) / _SHIFT
        self._prior: Array = self._slope[course.readings.size :]
        found, self._gradient = gradients(structure, laws.constants(structure.label, around), _SHIFT, asked, longest_s)
        self._tolerance = tolerance(found)

    def spread(self, looks: int) -> Array:
        """Return the smallest possible standard error of each answer after a number of readings, in tolerances."""
        read = self._told.whitened(self._slope[: looks * len(self._told.sigma)], self._course.first(looks))
        rows = np.vstack([read, self._prior])
        variance = np.einsum("qi,ij,qj->q", self._gradient, np.linalg.inv(rows.T @ rows), self._gradient)
        return _finite(np.sqrt(np.abs(variance)) / self._tolerance)

    def tightened(self, bound: float, chosen: list[int]) -> Situation:
        """Return the situation with the fewest readings, and then the most noise, that determines the answers."""
        told = self._told
        looks = next(
            (count for count in range(_LEAST_LOOKS, told.looks, 4) if self.spread(count)[chosen].max() <= bound),
            told.looks,
        )
        noise = max(
            told.noise, min(_MOST_NOISE, told.sigma[0] * bound / max(float(self.spread(looks)[chosen].max()), 1e-6))
        )
        return replace(told, looks=looks, noise=float(f"{noise:.2g}"))


def _finite(found: Array) -> Array:
    """Replace NaN by a very large number."""
    return np.where(np.isfinite(found), found, 1e9)


def _refuse_guessable(world: DrawnWorld, rng: random.Random) -> None:
    """Refuse a world if two of its answers can be found without inferring the law.

    Such answers need no experiment, or equal those measured in the nearest situation that the laboratory allows.
    """
    structure, constants, asked = world.structure, world.constants, world.questions
    key = np.array(world.key)
    numbers = np.array([not question.options for question in asked])  # `which` answers depend on no constant
    guesses = nearby(structure, constants, asked, world.told)
    for number in range(2):
        other = draw_constants(structure, rng) | {"m": constants["m"]}
        guesses[f"those of other constants ({number + 1})"] = answers(structure, other, asked, 0.03)[:, 0]
    for name, guess in guesses.items():
        if np.count_nonzero(numbers & (np.abs(_finite(guess) - key) <= tolerance(key))) > 1:
            raise Refused(f"two answers equal {name}")


def _determined(world: DrawnWorld, refits: Refits, difficulty: Difficulty) -> tuple[DrawnWorld, Refits]:
    """Increase readings and reduce noise until the readings exclude rival laws; returns the world and its readings.

    Raises:
        Refused: A rival law fits even with the most readings and the least noise of the difficulty.
    """
    structure, constants, told, key = world.structure, world.constants, world.told, np.array(world.key)
    rival: Fit | None = None
    while (rival := rival_of(refits, world.questions, key, rival)) is not None:
        looks = min(difficulty.looks, -(-int(told.looks * _SHARPER_LOOKS) // 2) * 2)
        noise = max(difficulty.noise, float(f"{told.noise / _SHARPER_NOISE:.2g}"))
        if (looks, noise) == (told.looks, told.noise):
            raise Refused("a rival law fits the readings, too")
        told = replace(told, looks=looks, noise=noise)
        refits = _refits(replace(world, told=told))
    bounds = _Information(structure, constants, told, world.questions).spread(told.looks)
    return replace(world, told=told, bounds=_numbers(bounds)), refits


def _refits(world: DrawnWorld) -> Refits:
    """Return simulated readings of a world, to which other structures are fitted."""
    course = simulated(world.structure, world.constants, world.told, _REFIT_SEED)
    return Refits(world.structure, world.constants, world.told, course)


def _refuse_useless(world: DrawnWorld, refits: Refits) -> None:
    """Refuse a world whose answers hardly change if a part is removed and the rest is refitted to the readings."""
    key = np.array(world.key)
    for part in world.structure.parts:
        fewer, rest = _less(world.structure, world.constants, part)
        refit = constants_of(refits.fitted(fewer, rest))
        found = answers(fewer, refit, world.questions, 0.03)[:, 0]
        if not refits.unexplained(fewer, refit):
            found = np.where([bool(question.options) for question in world.questions], key, found)
        if not (np.abs(_finite(found) - key) > MATTERS * tolerance(key)).any():
            raise Refused("the law without a term fits as well and gives the same answers")


def _refuse_mistakable(world: DrawnWorld, refits: Refits, rng: random.Random) -> None:
    """Refuse a world if another option of a `which` question explains the readings equally well."""
    for question in world.questions:
        if question.options and mistakable(refits, world.constants, question, rng):
            raise Refused("another option explains the readings, too")


def _refuse_unsolved(world: DrawnWorld, rng: random.Random) -> None:
    """Refuse a world if the reference, which knows the structure, cannot solve it from readings with other noise."""
    structure, key = world.structure, np.array(world.key)
    course = simulated(structure, world.constants, world.told, _SOLVE_SEED)
    unit = units_of(structure, world.constants)
    search = Search(Legs.of(course, world.told))
    fit = search.tell(structure, unit + _BESIDE * np.array([rng.gauss(0, 1) for _ in unit]))
    fit = on_course(course, world.told, fit, SEARCH_S)
    found = answers(structure, constants_of(fit), world.questions, 0.03)[:, 0]
    if not (np.abs(found - key) <= tolerance(key)).all():
        raise Refused("a reference that knows the terms is wrong")


def bounds_of(
    structure: Structure, constants: Mapping[str, float], told: Situation, questions: Sequence[Question]
) -> tuple[float, ...]:
    """Return the smallest possible standard error of each answer, given the certificate's readings, in tolerances."""
    with np.errstate(all="ignore"):
        return _numbers(_Information(structure, constants, told, questions).spread(told.looks))
