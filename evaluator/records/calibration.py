"""The result of a calibration as it is stored: difficulties, abilities, and variance components."""

from typing import Literal, NamedTuple

from evaluator.records.episode import Record

QUANTILE = 1.959964
"""Two-sided 95 % quantile of the normal distribution."""
DETECTED = QUANTILE + 0.841621
"""Difference that a two-sided test at 5 % detects with 80 % power [standard errors]."""
LEVELS = (-3, -2, -1, 0, 1, 2, 3)
"""Abilities at which the information of a rung is reported [logits]."""


class Spreads(NamedTuple):
    """Standard deviations of the random effects [logits]."""

    scene: float
    """Standard deviation of the part of the difficulties of scenes that their features do not explain."""
    variant: float
    """Standard deviation of variants around their scene; 0 if no scene has two variants."""


class VarianceComponents(NamedTuple):
    """Variance components of the accuracy of a taker, and the design from which they were estimated."""

    taker_scene: float
    """Variance between scenes in how hard each taker finds them."""
    taker_variant: float
    """Variance between variants of a scene, plus chance if there is one epoch; 0 if there is one seed."""
    epoch: float
    """Variance between repeated answers of one taker to one variant."""
    scenes: int
    seeds: int
    epochs: int

    def smallest_difference(self, scenes: int, seeds: int, epochs: int) -> float:
        """Return the smallest difference of two accuracies that a test at 5 % detects with 80 % power in a design.

        Args:
            scenes: Number of scenes that both takers play.
            seeds: Number of seeds per scene.
            epochs: Number of epochs per seed.
        """
        variance = self.taker_scene / scenes + self.taker_variant / (scenes * seeds)
        return DETECTED * (2 * (variance + self.epoch / (scenes * seeds * epochs))) ** 0.5


class Standing(Record):
    """Estimate for a scene or a taker."""

    name: str
    right: int
    answers: int
    logits: float
    """Difficulty or ability, relative to the mean difficulty of scenes with the average features."""
    se: float
    """Standard error [logits]."""
    infit: float
    """Mean square of the residuals, weighted by information: 1 if the model fits, larger if answers are noisier."""
    outfit: float
    """Unweighted mean square of the standardised residuals, which is sensitive to single surprising answers."""


class SceneStanding(Standing):
    """Estimate for a scene."""

    scene: int
    pack: str = ""
    """Content hash of its pack; empty in calibrations of version 0.2.0."""
    rung: str
    separation: float | None
    """Correlation between the takers' shares of right answers and their abilities; None if either is constant."""
    is_doubtful: bool
    """Whether abler takers are right significantly less often, so that the scene should be inspected."""


class Effect(Record):
    """Change of difficulty per standard deviation of a feature."""

    feature: str
    logits: float
    se: float


class Neighbours(Record):
    """Two takers with adjacent abilities."""

    better: str
    worse: str
    difference: float
    """Difference of their abilities [logits]."""
    se: float
    scenes: int | None
    """Number of scenes, with seeds and epochs as in the data, on which a test at 5 % detects the difference with 80 %
    power; None if it is 100,000 or more."""


class Calibration(Record):
    """The result of a calibration."""

    format: Literal[1] = 1
    takers: tuple[Standing, ...]
    """In descending order of ability."""
    scenes: tuple[SceneStanding, ...]
    """In descending order of difficulty."""
    effects: tuple[Effect, ...]
    spreads: Spreads
    information: dict[str, tuple[float, ...]]
    """Rung → mean information of one episode of its scenes at each ability in `LEVELS` [1/logit²]."""
    components: VarianceComponents | None
    pairs: tuple[Neighbours, ...]
