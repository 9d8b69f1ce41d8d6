"""What a calibration says: scenes and takers on one scale with errors, how well they fit it, and what to add. Pure.

On the answers 0 and 1 of the cells that all takers played: variance components of taker × scene, of taker × variant and
of the epochs, by the mean squares of the design (Brennan 2001, Generalizability Theory, ch. 3).
"""

import itertools
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from evaluator.calibration.model import FEATURES, Array, RaschFit, Spreads, fit
from evaluator.calibration.responses import Responses
from evaluator.records.episode import Record

DETECTED = 1.959964 + 0.841621
"""Standard errors of a difference that a two-sided test at 5 % finds with 80 % certainty."""


class VarianceComponents(NamedTuple):
    """Variance components of the accuracy of a taker, and the design in which they were found."""

    taker_scene: float
    """Takers find different scenes hard."""
    taker_variant: float
    """They find different variants of a scene hard, and luck, where there is one epoch; 0 where there is one seed."""
    epoch: float
    """The same taker answers the same variant differently."""
    scenes: int
    seeds: int
    epochs: int

    def smallest_difference(self, scenes: int, seeds: int, epochs: int) -> float:
        """Smallest difference of two accuracies that a test finds with 80 % certainty in a design.

        Args:
            scenes: Scenes that both play.
            seeds: Seeds of each scene.
            epochs: Epochs of each seed.
        """
        variance = self.taker_scene / scenes + self.taker_variant / (scenes * seeds)
        return DETECTED * (2 * (variance + self.epoch / (scenes * seeds * epochs))) ** 0.5


def components(data: Responses) -> VarianceComponents | None:
    """The components; None unless all takers share two scenes with equally many seeds each.

    Args:
        data: The answers.
    """
    played = np.bincount(data.variant, minlength=len(data.variants))
    common = [place for place in range(len(data.variants)) if played[place] == len(data.takers)]
    by_scene: dict[int, list[int]] = {}
    for place in common:
        by_scene.setdefault(data.variants[place][0], []).append(place)
    if len(by_scene) < 2:
        return None
    seeds = min(map(len, by_scene.values()))
    order = [place for places in by_scene.values() for place in places[:seeds]]
    share, count = (np.zeros((len(data.takers), len(data.variants))) for _ in range(2))
    share[data.taker, data.variant] = data.right / data.answers
    count[data.taker, data.variant] = data.answers
    share, count = share[:, order], count[:, order]
    epochs = int(count.min())
    within = float((share * (1 - share) * count / np.maximum(count - 1, 1))[count > 1].mean()) if epochs > 1 else 0.0
    rest = share - share.mean(axis=1, keepdims=True) - share.mean(axis=0, keepdims=True) + share.mean()
    scenes, takers = len(by_scene), len(data.takers)
    of_scene = rest.reshape(takers, scenes, seeds).mean(axis=2)
    between = seeds * float((of_scene**2).sum()) / ((takers - 1) * (scenes - 1))
    if seeds == 1:
        return VarianceComponents(max(0.0, between - within / epochs), 0.0, within, scenes, seeds, epochs)
    left = rest.reshape(takers, scenes, seeds) - of_scene[:, :, None]
    inner = float((left**2).sum()) / ((takers - 1) * scenes * (seeds - 1))
    of_variant = max(0.0, inner - within / epochs)
    return VarianceComponents(max(0.0, (between - inner) / seeds), of_variant, within, scenes, seeds, epochs)


LEVELS = (-3, -2, -1, 0, 1, 2, 3)
"""Abilities at which the information of a rung is told [logits]."""
_DOUBT = -1.645
"""Standardised deviation below which a scene that separates negatively is more than luck, at 5 %."""


class Standing(Record):
    """A scene or a taker on the scale."""

    name: str
    right: int
    answers: int
    logits: float
    """Difficulty or ability; the mean difficulty of scenes of this kind is 0."""
    se: float
    """Standard error [logits]."""
    infit: float
    """Mean square of the residuals, weighted by information: 1 if it fits, more if it is less orderly than that."""
    outfit: float
    """The same without weights, so that single surprises show."""


class SceneStanding(Standing):
    """A scene on the scale."""

    scene: int
    rung: str
    separation: float | None
    """Correlation between the share of right answers and the ability of takers; None if they do not differ."""
    is_doubtful: bool
    """Whether better takers are right less often, by more than luck: for a list of scenes to look into."""


class Effect(Record):
    """How much harder a scene is with one standard deviation more of a feature."""

    feature: str
    logits: float
    se: float


class Neighbours(Record):
    """Two neighbours in the order of abilities."""

    better: str
    worse: str
    difference: float
    """Of their abilities [logits]."""
    se: float
    scenes: int | None
    """Scenes, each with as many seeds and epochs as here, on which a test at 5 % finds the difference with 80 %
    certainty; None if no number of scenes below 100 000 does."""


class Calibration(Record):
    """The result of a calibration."""

    format: Literal[1] = 1
    takers: tuple[Standing, ...]
    """From the ablest."""
    scenes: tuple[SceneStanding, ...]
    """From the hardest."""
    effects: tuple[Effect, ...]
    spreads: Spreads
    information: dict[str, tuple[float, ...]]
    """Rung → information of one episode of an average scene about an ability of `LEVELS` [1/logit²]."""
    components: VarianceComponents | None
    pairs: tuple[Neighbours, ...]


class _Fitting(NamedTuple):
    infit: Array
    outfit: Array


def calibrate(data: Responses, features: Array, rungs: Sequence[str]) -> Calibration:
    """Put scenes and takers on one scale.

    Args:
        data: The answers.
        features: Standardised features, a row for each scene.
        rungs: The rung of each scene.
    """
    found = fit(data, features)
    by_taker, by_scene = (
        _fitting(data, found, index, size)
        for index, size in ((data.taker, len(data.takers)), (data.scene, len(data.scenes)))
    )
    takers = [
        Standing(name=name, **_place(data, data.taker, place, found.ability, found.ability_se, by_taker))
        for place, name in enumerate(data.takers)
    ]
    scenes = [
        SceneStanding(
            name=f"scene {scene}",
            scene=scene,
            rung=rungs[place],
            **_place(data, data.scene, place, found.difficulty, found.difficulty_se, by_scene),
            **_separation(data, found, place),
        )
        for place, scene in enumerate(data.scenes)
    ]
    return Calibration(
        takers=tuple(sorted(takers, key=lambda one: -one.logits)),
        scenes=tuple(sorted(scenes, key=lambda one: -one.logits)),
        effects=tuple(
            Effect(feature=name, logits=float(size), se=float(se))
            for name, column, size, se in zip(FEATURES, features.T, found.effect, found.effect_se, strict=True)
            if column.any()
        ),
        spreads=found.spreads,
        information={rung: _information(found, rungs, rung) for rung in sorted(set(rungs))},
        components=components(data),
        pairs=tuple(_pairs(data, found)),
    )


def _place(
    data: Responses, index: np.ndarray, place: int, value: Array, se: Array, fitting: _Fitting
) -> dict[str, Any]:
    own = index == place
    return {
        "right": int(data.right[own].sum()),
        "answers": int(data.answers[own].sum()),
        "logits": float(value[place]),
        "se": float(se[place]),
        "infit": float(fitting.infit[place]),
        "outfit": float(fitting.outfit[place]),
    }


def _fitting(data: Responses, found: RaschFit, index: np.ndarray, size: int) -> _Fitting:
    variance = data.answers * found.probability * (1 - found.probability)
    square = (data.right - data.answers * found.probability) ** 2
    of_each = [np.bincount(index, values, minlength=size) for values in (square, variance, square / variance)]
    return _Fitting(of_each[0] / of_each[1], of_each[2] / np.bincount(index, minlength=size))


def _separation(data: Responses, found: RaschFit, scene: int) -> dict[str, Any]:
    own = data.scene == scene
    ability, right, count = found.ability[data.taker[own]], data.right[own], data.answers[own]
    share, centred = right / count, ability - np.average(ability, weights=count)
    if np.ptp(share) == 0 or np.ptp(centred) == 0:
        return {"separation": None, "is_doubtful": False}
    correlation = float(np.corrcoef(centred, share)[0, 1])
    chance = float(right.sum() / count.sum())
    # What the sum would be if the scene told takers apart in no way.
    deviation = float((centred * (right - count * chance)).sum())
    spread = float((centred**2 * count).sum() * chance * (1 - chance)) ** 0.5
    return {"separation": correlation, "is_doubtful": correlation < 0 and deviation / spread < _DOUBT}


def _information(found: RaschFit, rungs: Sequence[str], rung: str) -> tuple[float, ...]:
    own = found.difficulty[np.array([one == rung for one in rungs])]
    shares = [1 / (1 + np.exp(own - level)) for level in LEVELS]
    return tuple(float((share * (1 - share)).mean()) for share in shares)


def _pairs(data: Responses, found: RaschFit) -> list[Neighbours]:
    order = [int(place) for place in np.argsort(-found.ability)]
    pairs: list[Neighbours] = []
    for better, worse in itertools.pairwise(order):
        difference = float(found.ability[better] - found.ability[worse])
        covariance = found.ability_covariance
        variance = covariance[better, better] + covariance[worse, worse] - 2 * covariance[better, worse]
        scenes = len(data.scenes) * float(variance) * (DETECTED / max(difference, 1e-9)) ** 2
        pairs.append(
            Neighbours(
                better=data.takers[better],
                worse=data.takers[worse],
                difference=difference,
                se=float(variance) ** 0.5,
                scenes=int(np.ceil(scenes)) if scenes < 1e5 else None,
            )
        )
    return pairs
