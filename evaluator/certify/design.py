"""Agents that measure how much the choice of experiments matters: `greedy-design` and `random-design`.

They know the pack of a scene, with the ranges of its hidden constants, but not the sampled values. Both choose from the
same limited set of experiments: a load that acts for some time, then a reading of what the question names.
`greedy-design` takes the experiment after which the Cramér-Rao bound of the answer at the present estimate is smallest,
or which best separates the two most probable discrete values (local, sequential c-optimal design; Fedorov 1972).
`random-design` takes a random experiment. Both estimate the constants by least squares on all readings, and answer with
the estimate.

They are loaded by `--agent MODULE:CLASS` because they run simulations, and the package `agents` must not import the
engine.
"""

import itertools
import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from scipy.optimize import least_squares

from evaluator.agents.attackers.readings import Opening, all_controls, motion_calls, read_opening, wait
from evaluator.agents.reference import ProtocolPlayer
from evaluator.certify.constants import Constants, shifted, span
from evaluator.certify.information import PRIOR, whitening
from evaluator.certify.probing import Array, NotMeasurable, Read, Replay, joined, numbers
from evaluator.certify.subject import Subject
from evaluator.episode.player import Briefing
from evaluator.errors import AgentError
from evaluator.records.episode import EpisodeKey
from physment_mcp.errors import SceneError
from scenes import AnswerKind, KnobValue, PackError, find_pack
from scenes.pack import Knob
from scenes.protocol import AnswerValue, Call, Protocol, Reading, answer, call

_MOST_COMBINATIONS = 12
"""Largest number of combinations of discrete hidden values with which a scene can be played."""
_MOST_CONTROLS, _MOST_WATCHED = 6, 3
_LEVELS = (1.0, -1.0, 0.2)
"""Loads of the experiments, as shares of the scene's limit."""
_DURATIONS_S = (0.2, 1.5)
_SHIFT = 1e-3
"""Finite-difference step, as a share of a constant's range."""
_FITS = 8
"""Largest number of evaluations of the residuals between two experiments, for each combination of discrete values."""
_APART = 25.0
"""Difference from the smallest chi-square beyond which a combination of discrete values is discarded."""


@dataclass(frozen=True, slots=True)
class _Estimate:
    """The fitted constants for one combination of discrete values."""

    discrete: Mapping[str, KnobValue]
    unit: Array
    """The continuous constants, in units of their ranges, from 0 to 1."""
    chi_square: float = 0.0


Pick = Callable[["Design", Sequence[list[Call]]], list[Call]]


@dataclass(slots=True)
class Design:
    """The state of a design agent during an episode."""

    subject: Subject
    pick: Pick
    turns: int
    """Largest number of iterations."""
    estimates: list[_Estimate] = field(init=False)
    made: list[tuple[Call, Reading]] = field(default_factory=list[tuple[Call, Reading]])

    def __post_init__(self) -> None:
        pack = self.subject.pack
        if not pack.knobs or self.subject.spec.kind in {AnswerKind.FORMULA, AnswerKind.TEXT}:
            raise AgentError("no design: the pack draws no hidden values, or its answer is a formula or a text")
        discrete = {name: _values(knob) for name, knob in pack.knobs.items() if not span(knob)}
        combinations = list(itertools.islice(itertools.product(*discrete.values()), _MOST_COMBINATIONS + 1))
        if len(combinations) > _MOST_COMBINATIONS:
            raise AgentError(f"no design: the pack has more than {_MOST_COMBINATIONS} combinations of discrete values")
        middle = np.full(sum(1 for knob in pack.knobs.values() if span(knob)), 0.5)
        self.estimates = [_Estimate(dict(zip(discrete, values, strict=True)), middle) for values in combinations]

    def constants(self, found: _Estimate) -> Constants:
        """Return the constants of an estimate."""
        names = tuple(name for name, knob in self.subject.pack.knobs.items() if span(knob))
        knobs: dict[str, KnobValue] = dict(found.discrete)
        for name, at in zip(names, found.unit, strict=True):
            knob = self.subject.pack.knobs[name]
            low, _ = cast("tuple[float, float]", span(knob))
            knobs[name] = shifted(knob, low, float(at))
        return Constants(self.subject, knobs, names)

    def replay(self, mjcf: str) -> tuple[Replay, list[Read]]:
        """Replay the calls of the episode so far in a model; returns the resulting laboratory and its readings."""
        lab = Replay(self.subject.files, mjcf)
        return lab, _read(lab, [one for one, reading in self.made if "error" not in reading], slopes=True)

    def told(self) -> Array:
        """Return the numbers that the real laboratory returned, in the same order as `replay` returns them."""
        reads = [reading for one, reading in self.made if one.tool not in _SILENT and "error" not in reading]
        return np.array([number for reading in reads for number in numbers(reading)])

    def fit(self) -> None:
        """Fit the constants to all readings for each combination of discrete values; drop improbable ones."""
        told, fitted = self.told(), list[_Estimate]()
        for found in self.estimates:
            try:
                fitted.append(self._fitted(found, told))
            except (NotMeasurable, PackError, SceneError):
                continue  # these values refuse a call that was accepted
        if not fitted:
            raise AgentError("no design: no values of the family return what was read")
        least = min(found.chi_square for found in fitted)
        self.estimates = sorted(
            (found for found in fitted if found.chi_square <= least + _APART), key=lambda found: found.chi_square
        )

    def _fitted(self, found: _Estimate, told: Array) -> _Estimate:
        _, reads = self.replay(self.constants(found).mjcf())
        whiten = whitening(reads)

        def misfits(unit: Array) -> Array:
            _, reads = self.replay(self.constants(replace(found, unit=unit)).mjcf())
            return np.concatenate([whiten @ (joined(reads) - told), math.sqrt(PRIOR) * (unit - 0.5)])

        if not len(found.unit):
            return replace(found, chi_square=float((misfits(found.unit) ** 2).sum()))
        inside = np.clip(found.unit, _SHIFT, 1 - _SHIFT)
        best = least_squares(misfits, inside, bounds=(0, 1), diff_step=np.full(len(inside), _SHIFT), max_nfev=_FITS)
        return replace(found, unit=best.x, chi_square=2 * float(best.cost))

    def suffices(self) -> bool:
        """Whether the readings determine the answer.

        Every number must be known to within `SUFFICIENT` tolerances and every choice with the probability `CERTAIN`.
        The answer must be the same for all remaining discrete values.
        """
        best = self.constants(self.estimates[0])
        if any(not self.subject.agrees(self.constants(one).key, best.key) for one in self.estimates[1:]):
            return False
        return best.are_known(_Survey.of(self, self.estimates[0]).fisher)

    def answer(self) -> AnswerValue:
        """Return the answer at the present estimate."""
        found = self.constants(self.estimates[0]).key
        return found if len(found) > 1 or self.subject.spec.kind is AnswerKind.NUMBERS else found[0]


_SILENT = frozenset({"apply_force", "apply_torque", "step"})


def _values(knob: Knob) -> list[KnobValue]:
    return list(knob.choice or itertools.permutations(knob.permutation or ()))


def _read(lab: Replay, calls: Sequence[Call], *, slopes: bool) -> list[Read]:
    found = (lab.read(place, one.tool, one.arguments, slopes=slopes) for place, one in enumerate(calls))
    return [read for read in found if read is not None]


@dataclass(frozen=True, slots=True)
class _Survey:
    """Simulated laboratories at an estimate and at slightly shifted constants, in the state after the calls so far."""

    base: Replay
    beside: Sequence[Replay]
    fisher: Array

    @classmethod
    def of(cls, design: Design, found: _Estimate) -> "_Survey":
        constants = design.constants(found)
        base, reads = design.replay(constants.mjcf())
        # Shifted inwards, so that no constant leaves its range.
        signs = [-1 if at > 0.5 else 1 for at in found.unit]
        shifts = [(name, sign * _SHIFT) for name, sign in zip(constants.names, signs, strict=True)]
        beside = [design.replay(constants.mjcf({name: by})) for name, by in shifts]
        slopes = _jacobian(reads, [read for _, read in beside], [by for _, by in shifts])
        fisher = PRIOR * np.eye(len(shifts)) + slopes.T @ slopes
        return cls(base, [lab for lab, _ in beside], fisher)

    def after(self, found: _Estimate, calls: Sequence[Call]) -> tuple[Array, list[Read]]:
        """Return the Fisher information after further calls, and the predicted readings of these calls."""
        with self.base.branch():
            reads = _read(self.base, calls, slopes=True)
        others: list[list[Read]] = []
        for lab in self.beside:
            with lab.branch():
                others.append(_read(lab, calls, slopes=False))
        slopes = _jacobian(reads, others, [(-1 if at > 0.5 else 1) * _SHIFT for at in found.unit])
        return self.fisher + slopes.T @ slopes, reads


def _jacobian(base: list[Read], beside: Sequence[list[Read]], shifts: Sequence[float]) -> Array:
    """Derivatives of whitened readings (readings, constants)."""
    middle = joined(base)
    columns = [(joined(reads) - middle) / by for reads, by in zip(beside, shifts, strict=True)]
    return whitening(base) @ np.column_stack(columns) if columns else np.zeros((len(middle), 0))


def experiments(opening: Opening, objects: Sequence[str]) -> list[list[Call]]:
    """Return the experiments that both design agents may choose: waiting, and loads on the objects of the task."""
    revealed = [name for name in objects if name not in opening.objects]
    watched = [*opening.named(), *revealed] or list(objects)
    reads = motion_calls(opening, watched[:_MOST_WATCHED], opening.units)
    controls = sorted(all_controls(opening, objects), key=lambda control: control.axis)[:_MOST_CONTROLS]
    loads = [(control.set(level * control.limit), control.set(0.0)) for control in controls for level in _LEVELS]
    return [
        *([*wait(duration), *reads] for duration in _DURATIONS_S),
        *([begin, *wait(duration), *reads, end] for begin, end in loads for duration in _DURATIONS_S),
    ]


def _played(design: Design, prompt: str) -> Protocol:
    opening = read_opening(prompt)
    objects = list(opening.objects)
    if "find_objects" not in opening.disabled:
        found = yield from _made(design, [call("find_objects")])
        objects += [str(listed["object_id"]) for listed in found[0].get("revealed", [])]
    options = experiments(opening, list(dict.fromkeys(objects)))
    for _ in range(design.turns - 2):
        calls_left = opening.calls - len(design.made)
        passed = sum(float(one.arguments["duration"]) for one, _ in design.made if one.tool == "step")
        possible = [
            batch
            for batch in options
            if len(batch) <= calls_left
            and sum(float(one.arguments["duration"]) for one in batch if one.tool == "step")
            <= opening.lab_time - passed
        ]
        if not possible:
            break
        yield from _made(design, design.pick(design, possible))
        design.fit()
        if design.suffices():
            break
    yield [answer(design.answer())]


def _made(design: Design, batch: list[Call]) -> Generator[list[Call], list[Reading], list[Reading]]:
    readings = yield batch
    design.made += zip(batch, readings, strict=True)
    return readings


def greedy(design: Design, options: Sequence[list[Call]]) -> list[Call]:
    """Return the most informative experiment.

    If several answers are still possible, it is the experiment that best separates the two most probable ones. If only
    one answer is left, it is the experiment after which the Cramér-Rao bound is smallest.
    """
    best = design.estimates[0]
    constants, survey = design.constants(best), _Survey.of(design, best)
    rival = next(
        (one for one in design.estimates[1:] if not design.subject.agrees(design.constants(one).key, constants.key)),
        None,
    )
    other = None if rival is None else design.replay(design.constants(rival).mjcf())[0]

    def worth(batch: list[Call]) -> float:
        try:
            fisher, reads = survey.after(best, batch)
            if other is not None:
                with other.branch():
                    apart = joined(_read(other, batch, slopes=False)) - joined(reads)
                return float(((whitening(reads) @ apart) ** 2).sum())
        except (NotMeasurable, ValueError):
            return -math.inf  # refused, or results of another form
        return -max(constants.bounds(fisher), default=-float(np.linalg.slogdet(fisher)[1]))

    return max(options, key=worth)


@dataclass(frozen=True, slots=True)
class _DesignAgent:
    name: str = ""

    def player(self, key: EpisodeKey, briefing: Briefing) -> ProtocolPlayer:
        """Start an episode.

        Raises:
            AgentError: These agents cannot play the scene, for example because it has too many discrete values.
        """
        try:
            subject = Subject.open(find_pack(key.scene))
        except PackError as error:
            raise AgentError(f"no design: {error}") from error
        design = Design(subject, self._pick(key), briefing.budget)

        def play(prompt: str) -> Protocol:
            """Play the episode: choose experiments, fit the constants of the scene to the readings, and answer."""
            return _played(design, prompt)

        return ProtocolPlayer(play, briefing.prompt)

    def _pick(self, key: EpisodeKey) -> Pick:
        del key
        return greedy


@dataclass(frozen=True, slots=True)
class GreedyDesign(_DesignAgent):
    """Chooses the experiment with the most information about the answer."""

    name: str = "greedy-design"


@dataclass(frozen=True, slots=True)
class RandomDesign(_DesignAgent):
    """Chooses a random experiment from the same set as `GreedyDesign`."""

    name: str = "random-design"

    def _pick(self, key: EpisodeKey) -> Pick:
        random = np.random.default_rng([key.scene, key.seed, key.epoch])
        return lambda _, options: options[int(random.integers(len(options)))]
