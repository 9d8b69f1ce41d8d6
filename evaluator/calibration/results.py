"""The results of a calibration: difficulties, abilities, their fit to the model, and variance components.

Variance components of taker × scene, taker × variant and epoch are estimated from the mean squares of the design, with
answers coded 0 and 1, on the cells that all takers played (Brennan 2001, Generalizability Theory, ch. 3).
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from evaluator.calibration.model import FEATURES, Array, RaschFit, Responses, fit
from evaluator.records.calibration import (
    DETECTED,
    LEVELS,
    Calibration,
    Effect,
    Neighbours,
    SceneStanding,
    Standing,
    VarianceComponents,
)

_DOUBT = -1.645
"""Standardised deviation below which negative separation is significant at 5 % (one-sided)."""


def components(data: Responses) -> VarianceComponents | None:
    """Estimate the variance components; None unless all takers share at least two scenes.

    Args:
        data: The answers. Of each shared scene, the same number of shared seeds is used.
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


class _Fitting(NamedTuple):
    infit: Array
    outfit: Array


def calibrate(
    data: Responses, features: Array, rungs: Sequence[str], packs: Mapping[int, str] | None = None
) -> Calibration:
    """Estimate difficulties and abilities on one scale.

    Args:
        data: The answers.
        features: Standardised features, one row per scene.
        rungs: The rung of each scene.
        packs: Scene → content hash of its pack, for the record.
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
            pack=(packs or {}).get(scene, ""),
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
    # Distribution of the sum if the scene did not discriminate between takers.
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
