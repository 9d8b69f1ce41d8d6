"""The explanatory Rasch model, fitted by penalised marginal likelihood to the answers in graded runs.

    logit P(right) = ability(taker) - difficulty(scene) - deviation(scene:seed)
    difficulty(scene) = features · effects + rest(scene)

A taker is an agent under one condition. The residual `rest` of a scene and the deviation of a variant are normal random
effects. Their standard deviations ("spreads") are estimated from the answers (partial pooling). The effects are
integrated out numerically on a grid, because Laplace's approximation makes abilities 7 to 10 % too small where few
takers answer a variant. Abilities and effects of features have wide normal priors. The prior density of a spread is
proportional to the spread, which prevents estimates of 0 from few answers (Chung et al. 2013, Psychometrika 78, 685).
Standard errors come from the curvature of the posterior at its mode, spreads included. The mean difficulty of scenes
with the average features is 0, which fixes the scale.
"""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from evaluator.certify.records import SceneCertificate, read_certificates
from evaluator.errors import UsageError
from evaluator.records.calibration import Spreads
from evaluator.records.episode import EpisodeKey, GradeRecord, Verdict
from evaluator.statistics.ability import ABILITY_SD, normal_grid
from scenes import Pack, content_hash_of, default_folder, find_pack, read_pack, reference_of


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


Array = NDArray[np.float64]
EFFECT_SD = 1.0
"""Prior standard deviation of effects of standardised features [logits]."""
_RESTS, _DEVIATIONS = 25, 9
"""Number of grid points for the residuals of scenes and for the deviations of variants."""
_CHANGE = 1e-4
"""Step of the finite differences for the curvature [logits]."""


@dataclass(frozen=True, slots=True)
class RaschFit:
    """A fitted model; all values except probabilities are in logits."""

    ability: Array
    """Ability of each taker."""
    ability_covariance: Array
    difficulty: Array
    """Difficulty of each scene; if it was played at one seed, the difficulty of that variant."""
    difficulty_se: Array
    effect: Array
    """Change of difficulty per standard deviation of each feature."""
    effect_se: Array
    spreads: Spreads
    probability: Array
    """Probability of a right answer at another variant of the scene, for each cell of taker, scene and seed."""

    @property
    def ability_se(self) -> Array:
        """Standard error of each ability."""
        return np.sqrt(np.diag(self.ability_covariance))


class _State(NamedTuple):
    """A parameter vector of the model, and quantities computed from it."""

    loss: float
    """Negative logarithm of the posterior density."""
    gradient: Array
    difficulty: Array
    """Posterior mean of each scene's difficulty, given the parameters."""
    variance: Array
    """Posterior variance of each scene's difficulty, given the parameters."""


def fit(data: Responses, features: Array) -> RaschFit:
    """Fit the model.

    Args:
        data: The answers.
        features: Standardised features, one row per scene.
    """
    posterior = _Posterior(data, features)
    start = np.zeros(posterior.size)
    bounds = [(-12.0, 12.0)] * posterior.fixed + [(-4.0, 1.5)] * (posterior.size - posterior.fixed)

    def loss(parameters: Array) -> tuple[float, Array]:
        state = posterior.at(parameters)
        return state.loss, state.gradient

    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 1e-10, "maxiter": 300})
    return posterior.fit_at(np.asarray(found.x, dtype=float))


class _Posterior:
    """The posterior density of abilities, effects and spreads, given the answers."""

    def __init__(self, data: Responses, features: Array) -> None:
        # Sort cells by variant and variants by scene, so that `np.add.reduceat` can sum over slices.
        order = np.lexsort((data.taker, data.variant))
        self.taker, self.scene, variant = (part[order] for part in (data.taker, data.scene, data.variant))
        self.right, self.answers = data.right[order], data.answers[order]
        self.data, self.features = data, features
        self.has_variants = len(data.variants) > len(data.scenes)
        self.fixed = len(data.takers) + features.shape[1]
        self.size = self.fixed + 1 + self.has_variants
        self.variant = variant
        self.first_cells = np.searchsorted(variant, np.arange(len(data.variants)))
        scene_of = np.array([data.scenes.index(scene) for scene, _ in data.variants])
        self.scene_of = scene_of
        self.first_variants = np.searchsorted(scene_of, np.arange(len(data.scenes)))
        self.rests, self.rest_weights = normal_grid(_RESTS)
        self.deviations, self.deviation_weights = normal_grid(_DEVIATIONS if self.has_variants else 1)
        self.penalty = np.array([ABILITY_SD**-2.0] * len(data.takers) + [EFFECT_SD**-2.0] * features.shape[1])

    def at(self, parameters: Array) -> _State:
        ability, effect, spreads = self.split(parameters)
        explained = self.features @ effect
        middle = ability[self.taker] - explained[self.scene]
        shift = spreads.scene * self.rests[:, None] + spreads.variant * self.deviations
        odds = np.exp(middle)[:, None, None] * np.exp(-shift)
        right, stated = (np.add.reduceat(part, self.first_cells) for part in (self.right, self.right * middle))
        certain = np.add.reduceat(self.answers[:, None, None] * np.log1p(odds), self.first_cells, axis=0)
        # Integrate over the deviation of each variant, then over the residual of each scene.
        of_variant = stated[:, None, None] - right[:, None, None] * shift - certain + self.deviation_weights
        inner = _log_sum(of_variant, 2)
        of_scene = np.add.reduceat(inner, self.first_variants, axis=0) + self.rest_weights
        total = _log_sum(of_scene, 1)
        of_rest = np.exp(of_scene - total[:, None])
        weight = np.exp(of_variant - inner[:, :, None]) * of_rest[self.scene_of][:, :, None]
        expected = self.answers[:, None, None] * (odds / (1 + odds))
        of_cell = weight[self.variant]
        by_cell = self.right * of_cell.sum(axis=(1, 2)) - np.einsum("ijk,ijk->i", expected, of_cell)
        by_scene = np.bincount(self.scene, by_cell, minlength=len(explained))
        fixed = np.concatenate([np.bincount(self.taker, by_cell, minlength=len(ability)), -self.features.T @ by_scene])
        missed = right[:, None, None] - np.add.reduceat(expected, self.first_cells, axis=0)
        by_point = (missed * weight).sum(axis=0)
        sizes = [-spreads.scene * float((by_point * self.rests[:, None]).sum()) + 1]
        if self.has_variants:
            sizes.append(-spreads.variant * float((by_point * self.deviations).sum()) + 1)
        own = parameters[: self.fixed]
        loss = float(parameters[self.fixed :].sum() + total.sum()) - 0.5 * float((self.penalty * own**2).sum())
        gradient = np.concatenate([fixed - self.penalty * own, sizes])
        mean = of_rest @ self.rests
        variance = spreads.scene**2 * (of_rest @ self.rests**2 - mean**2)
        return _State(-loss, -gradient, explained + spreads.scene * mean, variance)

    def split(self, parameters: Array) -> tuple[Array, Array, Spreads]:
        takers, sizes = len(self.data.takers), np.exp(parameters[self.fixed :])
        spreads = Spreads(float(sizes[0]), float(sizes[1]) if self.has_variants else 0.0)
        return parameters[:takers], parameters[takers : self.fixed], spreads

    def fit_at(self, mode: Array) -> RaschFit:
        curvature, slope = np.zeros((self.size, self.size)), np.zeros((len(self.data.scenes), self.size))
        state, takers = self.at(mode), len(self.data.takers)
        for place in range(self.size):
            step = np.zeros(self.size)
            step[place] = _CHANGE
            above = self.at(mode + step)
            curvature[place] = (above.gradient - state.gradient) / _CHANGE
            slope[:, place] = (above.difficulty - state.difficulty) / _CHANGE
        covariance = np.asarray(np.linalg.inv((curvature + curvature.T) / 2), dtype=float)
        ability, effect, spreads = self.split(mode)
        # A logistic curve averaged over normal deviations is approximately a logistic curve with a smaller slope.
        flatter = float(np.sqrt(1 + (16 * np.sqrt(3) / (15 * np.pi)) ** 2 * spreads.variant**2))
        logits = (ability[self.data.taker] - state.difficulty[self.data.scene]) / flatter
        return RaschFit(
            ability,
            covariance[:takers, :takers],
            state.difficulty,
            np.sqrt(state.variance + np.einsum("ij,jk,ik->i", slope, covariance, slope)),
            effect,
            np.sqrt(np.diag(covariance)[takers : self.fixed]),
            spreads,
            1 / (1 + np.exp(-logits)),
        )


def _log_sum(values: Array, axis: int) -> Array:
    """Return the logarithm of the sum of exponentials along an axis."""
    most = values.max(axis=axis, keepdims=True)
    return np.log(np.exp(values - most).sum(axis=axis)) + most.squeeze(axis)


FEATURES = (
    "hard",
    "several concepts",
    "hidden bodies",
    "something to create, delete or attach",
    "laws",
    "noise",
    "possible structures",
    "interventions of the reference",
    "lab time of the reference",
)
"""Names of the features. The last three are logarithms."""


def features_of(scenes: Sequence[int], scenes_dir: Path | None = None) -> Array:
    """Return the standardised features of scenes, one row per scene; a constant feature is 0.

    Args:
        scenes: Ids of the scenes.
        scenes_dir: Folder of scene packs; None for the suite.

    Raises:
        PackError: A pack is missing or malformed.
    """
    stored = read_certificates(scenes_dir or default_folder())
    certificates = {one.scene: one for one in stored.scenes} if stored else {}
    packs = [read_pack(find_pack(scene, scenes_dir)) for scene in scenes]
    table = np.array([_row(pack, certificates.get(scene)) for scene, pack in zip(scenes, packs, strict=True)])
    spread = table.std(axis=0)
    return (table - table.mean(axis=0)) / np.where(spread > 0, spread, 1.0)


def _row(pack: Pack, certificate: SceneCertificate | None) -> list[float]:
    category = pack.category.value if pack.category else ""
    noise = pack.instruments.noise if pack.instruments else None
    structures = _structures(_figure(certificate, "structure", "structures"))
    return [
        float(category.startswith("hard")),
        float("multi" in category),
        float(sum(allowed.hidden for allowed in pack.object_permissions.values())),
        float("creation" in category or category == "create-delete-attach"),
        float(len(pack.laws)),
        float(bool(noise)),
        math.log(structures),
        _logarithm(_figure(certificate, "difficulty", "interventions")),
        _logarithm(_figure(certificate, "instrument", "lab_time_s")),
    ]


def _figure(certificate: SceneCertificate | None, check: str, name: str) -> object:
    """Return a value that a check of a certificate recorded; None if there is none."""
    checks = certificate.checks if certificate else ()
    return next((one.figures.get(name) for one in checks if one.name == check), None)


def _structures(labels: object) -> int:
    """Return the number of structures that a scene may have; 1 if its certificate names none."""
    return len(cast("list[str]", labels)) if isinstance(labels, list) and labels else 1


def _logarithm(value: object) -> float:
    return math.log1p(value) if isinstance(value, int | float) else 0.0
