"""Extracts the right and wrong answers from graded runs for a calibration."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.errors import UsageError
from evaluator.records.episode import EpisodeKey, GradeRecord, Verdict
from scenes import content_hash_of, reference_of


class Responses(NamedTuple):
    """Counts of answers per cell of taker, scene and seed. Each array has one entry per cell."""

    takers: Sequence[str]
    """Name of each taker: an agent under one condition."""
    scenes: Sequence[int]
    variants: Sequence[tuple[int, int]]
    """Scene and seed of each variant."""
    taker: NDArray[np.intp]
    """Index into `takers`."""
    scene: NDArray[np.intp]
    """Index into `scenes`."""
    variant: NDArray[np.intp]
    """Index into `variants`."""
    right: NDArray[np.float64]
    """Number of right answers in the cell."""
    answers: NDArray[np.float64]
    """Number of answers in the cell, which is its number of epochs."""


def responses(runs: Mapping[str, Sequence[GradeRecord]]) -> Responses:
    """Count the answers of graded runs.

    Args:
        runs: Name of a run → its grades, without those of scenes that are not to be calibrated.

    Raises:
        UsageError: The answers do not suffice for a calibration, or were given on different packs of a scene.
    """
    grades = [(name, one) for name, run in runs.items() for one in run if one.grade.strict is not Verdict.UNSCORED]
    if not grades:
        raise UsageError("there is no graded episode of the suite to calibrate from")
    _refuse_mixed_packs(grades)
    takers = _takers([one.key for _, one in grades])
    if len(set(takers)) < 2:
        raise UsageError(f"only {takers[0]} was played, and one agent cannot tell hard scenes from a weak agent")
    right = [one.grade.strict is Verdict.CORRECT for _, one in grades]
    if len(set(right)) == 1:
        said = "right" if right[0] else "wrong"
        raise UsageError(f"all {len(right)} answers are {said}, so no scene can be told from another")
    counts: defaultdict[tuple[str, int, int], list[bool]] = defaultdict(list)
    for taker, (_, one), verdict in zip(takers, grades, right, strict=True):
        counts[taker, one.key.scene, one.key.seed].append(verdict)
    return counted_responses({cell: (sum(found), len(found)) for cell, found in counts.items()})


def counted_responses(counts: Mapping[tuple[str, int, int], tuple[int, int]]) -> Responses:
    """Build the arrays from counts.

    Args:
        counts: Taker, scene and seed → number of right answers, number of answers.
    """
    cells = sorted(counts)
    takers = sorted({taker for taker, _, _ in cells})
    scenes = sorted({scene for _, scene, _ in cells})
    variants = sorted({(scene, seed) for _, scene, seed in cells})
    places = [{name: place for place, name in enumerate(names)} for names in (takers, scenes, variants)]
    return Responses(
        takers,
        scenes,
        variants,
        np.array([places[0][taker] for taker, _, _ in cells]),
        np.array([places[1][scene] for _, scene, _ in cells]),
        np.array([places[2][scene, seed] for _, scene, seed in cells]),
        np.array([counts[cell][0] for cell in cells], dtype=float),
        np.array([counts[cell][1] for cell in cells], dtype=float),
    )


def _takers(keys: Sequence[EpisodeKey]) -> list[str]:
    """Return the name of each episode's taker: its agent, and the conditions that differ between episodes."""
    names = [name for name in ("budget", "prompting", "protocol") if len({str(getattr(key, name)) for key in keys}) > 1]
    parts = [[f"{'budget ' if name == 'budget' else ''}{getattr(key, name)}" for name in names] for key in keys]
    return [f"{key.agent} ({', '.join(more)})" if more else key.agent for key, more in zip(keys, parts, strict=True)]


def _refuse_mixed_packs(grades: Sequence[tuple[str, GradeRecord]]) -> None:
    packs: dict[int, tuple[str, str]] = {}
    for name, one in grades:
        pack = content_hash_of(one.pack_version)
        first, known = packs.setdefault(one.key.scene, (name, pack))
        if pack != known:
            raise UsageError(
                f"{first} and {name} were played on different packs of scene {reference_of(one.key.scene)}, which are"
                " not the same task; calibrate runs of the same packs"
            )
