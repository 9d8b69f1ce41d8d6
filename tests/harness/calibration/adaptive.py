"""Simulates adaptive tests: compares a test of half the length with the full test, and checks the coverage of
intervals.

`python -m tests.harness.calibration.adaptive [TAKERS] [TABLES]`. Each table of difficulties is itself estimated, by the
model of `calibrate` from the simulated answers of thirty takers, so that its errors count. Abilities are relative to
the mean difficulty of the scenes of the table.
"""

import sys
from typing import NamedTuple

import numpy as np

from evaluator.calibration.adaptive import AdaptiveTest
from evaluator.calibration.model import fit
from evaluator.records.episode import EpisodeKey
from evaluator.statistics.ability import Ability, SceneDifficulty
from tests.harness.calibration.coverage import Design, drawn

CALIBRATED = Design(30, seeds=3)
"""Simulated takers from whose answers the difficulties are estimated: as many as `evaluator.agents.takers` has."""
ABILITY_SD = 1.5
"""Standard deviation of the abilities of the tested takers [logits]."""
TARGET = 0.3
"""Standard error at which the third test stops [logits]."""


class Laboratory(NamedTuple):
    """A simulated suite: the estimated and the true difficulties of its scenes."""

    known: dict[int, SceneDifficulty]
    logits: np.ndarray
    """The true difficulty of each scene, relative to their mean."""


class Tested(NamedTuple):
    """The abilities of one simulated taker, estimated by three tests."""

    truth: float
    full: Ability
    """Estimate from one answer in every scene."""
    half: Ability
    """Estimate from half as many answers, in scenes chosen by an adaptive test."""
    stopped: Ability
    """Estimate of an adaptive test that stops at the standard error `TARGET`, or when no scene is left."""


def laboratory(source: np.random.Generator) -> Laboratory:
    """Sample the true difficulties of scenes, and estimate them from the answers of simulated takers."""
    one = drawn(CALIBRATED, source)
    found = fit(one.data, one.features)
    middle = found.difficulty.mean()
    known = {
        scene: SceneDifficulty(float(logits - middle), float(se), found.spreads.variant)
        for scene, (logits, se) in enumerate(zip(found.difficulty, found.difficulty_se, strict=True))
    }
    return Laboratory(known, one.difficulty - one.difficulty.mean())


def tested(lab: Laboratory, name: str, source: np.random.Generator) -> Tested:
    """Sample a taker's ability and its answers at one new seed per scene, and run the three tests."""
    ability = float(source.normal(0, ABILITY_SD))
    logits = ability - lab.logits - source.normal(0, CALIBRATED.seed_sd, len(lab.logits))
    right = source.random(len(logits)) < 1 / (1 + np.exp(-logits))
    keys = [EpisodeKey(scene=scene, seed=0, agent=name, budget=20) for scene in lab.known]
    full = AdaptiveTest(name, lab.known, 0.0, [])
    for key in keys:
        full.add(key, is_right=bool(right[key.scene]))
    test, stopped = AdaptiveTest(name, lab.known, 0.0, list(keys)), None
    for _ in range(len(keys) // 2):
        ((key, _),) = test.choose(1)
        test.add(key, is_right=bool(right[key.scene]))
        now = test.ability()
        stopped = now if stopped is None and now.se <= TARGET else stopped
    half = test.ability()
    while stopped is None and (chosen := test.choose(1)):
        test.add(chosen[0][0], is_right=bool(right[chosen[0][0].scene]))
        now = test.ability()
        stopped = now if now.se <= TARGET else None
    return Tested(ability, full.ability(), half, stopped or test.ability())


def covers(truth: float, found: Ability) -> bool:
    """Whether the 95 % interval of an estimated ability contains the true ability."""
    return found.interval.low <= truth <= found.interval.high


def simulated(takers: int, tables: int, source: np.random.Generator) -> list[Tested]:
    """Test simulated takers on several simulated suites."""
    found: list[Tested] = []
    for _ in range(tables):
        lab = laboratory(source)
        found += [tested(lab, f"t{number}", source) for number in range(takers // tables)]
    return found


def main(takers: int, tables: int) -> None:
    """Print the length, the root mean square errors and the coverage of intervals of each test."""
    found = simulated(takers, tables, np.random.default_rng(20261126))
    for name in ("full", "half", "stopped"):
        those = [getattr(one, name) for one in found]
        error = np.sqrt(np.mean([(one.ability - each.truth) ** 2 for one, each in zip(those, found, strict=True)]))
        away = np.sqrt(
            np.mean([(one.ability - each.full.ability) ** 2 for one, each in zip(those, found, strict=True)])
        )
        covered = np.mean([covers(each.truth, one) for one, each in zip(those, found, strict=True)])
        length, se = np.mean([one.answers for one in those]), np.mean([one.se for one in those])
        print(
            f"{name}: {length:.1f} episodes, SE {se:.3f}, RMSE {error:.3f} to the truth, {away:.3f} to the full test,"
            f" {covered:.4f} of {len(those)} intervals cover"
        )
    every = [covers(one.truth, which) for one in found for which in one[1:]]
    print(f"pooled: {np.mean(every):.4f} of {len(every)} intervals")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:] or (2000, 20)))
