"""Measures how often the 95 % intervals contain the true parameters of simulated takers and scenes.

python tests/harness/calibration/coverage.py [REPLICATIONS]
"""

import sys
import time
from typing import NamedTuple

import numpy as np

from evaluator.calibration.model import Responses, counted_responses, fit


class Design(NamedTuple):
    """Design of a simulation: numbers of takers, scenes and variants; standard deviations in logits."""

    takers: int
    scenes: int = 105
    seeds: int = 5
    scene_sd: float = 1.2
    seed_sd: float = 0.6
    ability_sd: float = 1.5


DESIGNS = (
    Design(10, seeds=1),
    Design(10, scenes=40, seeds=3, seed_sd=1.2),
    Design(20, scenes=60, seeds=2),
    Design(8, scenes=60, seeds=4),
    Design(3, seeds=3),
)


class Drawn(NamedTuple):
    """Simulated answers and the true parameters from which they were sampled."""

    data: Responses
    features: np.ndarray
    ability: np.ndarray
    difficulty: np.ndarray


def drawn(design: Design, source: np.random.Generator) -> Drawn:
    """Sample takers, scenes and answers; of a scene's three features, the last does not affect the difficulty."""
    features = source.normal(size=(design.scenes, 3))
    features = (features - features.mean(axis=0)) / features.std(axis=0)
    difficulty = features @ np.array([0.8, -0.4, 0.0]) + source.normal(0, design.scene_sd, design.scenes)
    ability = source.normal(0, design.ability_sd, design.takers)
    deviation = source.normal(0, design.seed_sd, (design.scenes, design.seeds))
    if design.seeds == 1:
        difficulty += deviation[:, 0]  # of the only variant that was played
        deviation *= 0
    logits = ability[:, None, None] - difficulty[None, :, None] - deviation[None]
    right = source.random(logits.shape) < 1 / (1 + np.exp(-logits))
    counts = {(f"t{t:03}", s, v): (int(right[t, s, v]), 1) for t, s, v in np.ndindex(right.shape)}
    return Drawn(counted_responses(counts), features, ability, difficulty)


def covered(found: Drawn) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each ability and difficulty, whether its interval contains the true value."""
    fitted = fit(found.data, found.features)
    abilities = np.abs(fitted.ability - found.ability) <= 1.96 * fitted.ability_se
    return abilities, np.abs(fitted.difficulty - found.difficulty) <= 1.96 * fitted.difficulty_se


def main(replications: int) -> None:
    """Print the coverage of each design, and that of all designs together."""
    source, pooled = np.random.default_rng(20261123), []
    for design in DESIGNS:
        start, abilities, difficulties = time.monotonic(), [], []
        for _ in range(replications):
            ability, difficulty = covered(drawn(design, source))
            abilities += list(ability)
            difficulties += list(difficulty)
        pooled += abilities
        each = (time.monotonic() - start) / replications
        print(
            f"{design}: abilities {np.mean(abilities):.3f} of {len(abilities)},"
            f" difficulties {np.mean(difficulties):.3f} of {len(difficulties)}, {each:.1f} s a fit",
            flush=True,
        )
    print(f"pooled: {np.mean(pooled):.4f} of {len(pooled)} intervals of abilities")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 80)
