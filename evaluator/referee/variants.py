"""The variants that a trainer may play: resolves requests to variants, and lists properties of scenes."""

import secrets
from collections.abc import Mapping
from dataclasses import dataclass, field

from evaluator.answers.keys import KeyRing
from evaluator.answers.rewards import chance_of_form
from evaluator.certify.records import SceneCertificate, read_certificates
from evaluator.episode.connections import without_seed
from evaluator.errors import RefusedRequest, UsageError
from evaluator.records.episode import EpisodeKey
from evaluator.records.run import RunRecord
from evaluator.referee.contract import Variant, WantedEpisode, WantedVariants
from evaluator.referee.curriculum import Curricula, steps_of
from evaluator.referee.selection import curriculum_pool, pool_of, variant_of
from evaluator.scores.grouping import rung
from evaluator.study.integrity import played_worlds
from scenes import ErratumEffect, default_folder, find_pack, is_world, pack_hash, place_of, reference_of


@dataclass(frozen=True, slots=True)
class PoolFacts:
    """Public properties of a scene; none of them depends on an answer key."""

    scene: int
    world: str | None
    """Reference of a world, such as `world:5:17`."""
    level: int | None
    """Level of a world."""
    rung: str
    category: str
    answer_parts: int
    """Number of values that an answer has."""
    chance: float
    """Probability that a blind guess is right."""
    reference_iterations: int | None
    """Iterations of the reference protocol at seed 0; None if no certificate gives them."""
    reference_calls: float | None
    """Median number of calls of the reference protocol; None if no certificate gives it."""
    difficulty: float | None
    """Difficulty in the referee's calibration [logits]; None if the calibration lacks this pack."""
    difficulty_se: float | None


@dataclass(frozen=True, slots=True)
class VariantPage:
    """One page of the list of a split's scenes, with their public properties."""

    split: str
    """Name and version of the split."""
    variants: int
    """Number of its variants: scenes times seeds."""
    scenes: int
    """Number of its scenes."""
    facts: list[PoolFacts]
    """Facts about the scenes on this page, by ascending id."""


@dataclass(slots=True)
class Variants:
    """Selects the variants that a referee opens, and provides their answer keys."""

    keys: KeyRing
    record: RunRecord
    difficulties: Mapping[int, tuple[float, float]] = field(default_factory=dict[int, tuple[float, float]])
    """Scene → difficulty and its standard error [logits]."""
    curricula: Curricula = field(default_factory=Curricula)
    _certificates: dict[int, SceneCertificate] | None = None

    @property
    def _held_back(self) -> bool:
        return bool(self.record.plan.held_back)

    def select(self, wanted: WantedEpisode, curriculum: str | None = None) -> Variant:
        """Return the variant that a request selects, or draw one from the window of a curriculum.

        Raises:
            RefusedRequest: The request names no variant, or more than one, or the curriculum has other scenes.
        """
        if curriculum is None:
            return variant_of(wanted, held_back=self._held_back, folder=self.keys.folder)
        pool = curriculum_pool(wanted, held_back=self._held_back, folder=self.keys.folder)
        random_seed = secrets.randbits(64) if wanted.random_seed is None else wanted.random_seed
        return self.curricula.draw(curriculum, pool, steps_of(pool, self.difficulties), random_seed)

    def key(self, variant: Variant, wanted: WantedEpisode, agent: str) -> EpisodeKey:
        """Return the episode key under which an episode is recorded.

        Raises:
            RefusedRequest: The variant has no answer key, or its scene is withdrawn, so it must not be played.
        """
        scene, seed = variant.scene, variant.seed
        try:
            self.keys.key(scene, seed)
            if is_world(scene):
                self._record_world(scene)
            erratum = self.keys.erratum(self.record.packs[str(scene)])
        except UsageError as error:
            raise RefusedRequest(404, str(without_seed(error, self.keys.seed_of(scene, seed), seed))) from error
        if erratum is not None and erratum.effect is ErratumEffect.WITHDRAWN:
            raise RefusedRequest(404, f"scene {reference_of(scene)} is withdrawn: {erratum.fault}")
        return EpisodeKey(scene=scene, seed=seed, agent=agent, budget=wanted.budget, prompting=wanted.prompting)

    def _record_world(self, scene: int) -> None:
        """Add a world to the run record, because the record cannot list all worlds at the start."""
        if str(scene) not in self.record.packs:
            files = find_pack(scene, self.keys.folder)
            self.record.worlds.update(played_worlds([files], self.keys.folder))
            self.record.packs[str(scene)] = pack_hash(files)

    def listed(self, wanted: WantedVariants) -> VariantPage:
        """Return one page of the list of a split's scenes or worlds, with their public properties.

        Raises:
            RefusedRequest: There is no such split, or no such world.
        """
        pool = pool_of(wanted, held_back=self._held_back, folder=self.keys.folder)
        scenes = pool.scenes[wanted.offset : wanted.offset + wanted.limit]
        try:
            found = [self.facts(scene) for scene in scenes]
        except UsageError as error:
            raise RefusedRequest(404, str(error)) from error
        return VariantPage(pool.label, len(pool.scenes) * len(pool.seeds), len(pool.scenes), found)

    def facts(self, scene: int) -> PoolFacts:
        """Return the public properties of a scene.

        Raises:
            UsageError: There is no such scene.
        """
        key, category = self.keys.key(scene, 0), self.keys.facts(scene).category
        certificate = self._certified().get(scene)
        checks = {check.name: check.figures for check in certificate.checks} if certificate else {}
        iterations = checks.get("difficulty", {}).get("iterations")
        calls = checks.get("instrument", {}).get("calls")
        difficulty, error = self.difficulties.get(scene, (None, None))
        return PoolFacts(
            scene=scene,
            world=reference_of(scene) if is_world(scene) else None,
            level=place_of(scene)[0] if is_world(scene) else None,
            rung=rung(category),
            category=category,
            answer_parts=len(key.parts),
            chance=chance_of_form(key.spec),
            reference_iterations=int(iterations) if isinstance(iterations, int | float) else None,
            reference_calls=float(calls) if isinstance(calls, int | float) else None,
            difficulty=difficulty,
            difficulty_se=error,
        )

    def _certified(self) -> dict[int, SceneCertificate]:
        """The certificate of each scene; empty for a folder without certificates."""
        if self._certificates is None:
            found = read_certificates(self.keys.folder or default_folder())
            self._certificates = {one.scene: one for one in found.scenes} if found else {}
        return self._certificates
