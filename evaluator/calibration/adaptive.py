"""Computerised adaptive tests: the answers so far and calibrated difficulties decide which scene a taker plays next.

Candidates are ranked by their Fisher information at the present estimate of the ability. As exposure control, the scene
is drawn from the five most informative ones ("randomesque"), so that takers of the same ability do not all play the
same scenes.

Source: van der Linden and Glas 2010, Elements of Adaptive Testing; Kingsbury and Zara 1989, Applied Measurement in
Education 2, 359.
"""

import hashlib
import random
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from evaluator.errors import UsageError, reason_of
from evaluator.records.calibration import QUANTILE, Calibration
from evaluator.records.episode import Choice, EpisodeKey
from evaluator.statistics.ability import (
    Ability,
    Array,
    SceneDifficulty,
    information,
    posterior_ability,
    scene_likelihood,
)
from scenes import PackFiles, same_pack

DIFFICULTIES = Path(__file__).with_name("difficulties.json")
"""The calibration that ships with the package."""
EXPOSED = 5
"""Number of most informative scenes from which the next scene is drawn."""


@dataclass(frozen=True, slots=True)
class DifficultyTable:
    """Difficulties of scenes."""

    difficulties: Mapping[int, SceneDifficulty]
    packs: Mapping[int, str]
    """Scene → content hash of the pack that was calibrated."""
    sha256: str
    """SHA-256 of the file."""

    def holds(self, files: PackFiles) -> bool:
        """Return whether the table holds the difficulty of this version of a pack."""
        return same_pack(self.packs.get(files.scene_id, ""), files)


def read_calibration(file: Path = DIFFICULTIES) -> Calibration:
    """Read a `calibration.json`.

    Raises:
        UsageError: The file cannot be read or is malformed.
    """
    return _parsed(file, _content(file))


def _content(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise UsageError(f"{file} cannot be read as a calibration: {reason_of(error)}") from error


def _parsed(file: Path, content: bytes) -> Calibration:
    try:
        return Calibration.model_validate_json(content)
    except ValueError as error:
        raise UsageError(f"{file} cannot be read as a calibration: {reason_of(error)}") from error


def read_difficulties(file: Path = DIFFICULTIES) -> DifficultyTable:
    """Read the difficulties from a `calibration.json`.

    Raises:
        UsageError: The file cannot be read or is malformed.
    """
    content = _content(file)
    found = _parsed(file, content)
    difficulties = {one.scene: SceneDifficulty(one.logits, one.se, found.spreads.variant) for one in found.scenes}
    packs = {one.scene: one.pack for one in found.scenes}
    return DifficultyTable(difficulties, packs, hashlib.sha256(content).hexdigest())


@dataclass(slots=True)
class AdaptiveTest:
    """The test of one taker."""

    name: str
    """Name of the taker; it seeds the random numbers of the exposure control."""
    difficulties: Mapping[int, SceneDifficulty]
    target: float
    """Standard error of the ability at which the test ends [logits]."""
    waiting: list[EpisodeKey]
    """Episodes that have not been chosen yet, in the order in which those of one scene are chosen."""
    answers: dict[int, dict[int, tuple[int, int]]] = field(default_factory=dict[int, dict[int, tuple[int, int]]])
    """Scene → seed → number of right answers and number of answers."""
    likelihoods: dict[int, Array] = field(default_factory=dict[int, Array])
    """Scene → logarithm of the likelihood of its answers."""

    def add(self, key: EpisodeKey, *, is_right: bool) -> None:
        """Count the answer of an episode."""
        of_scene = self.answers.setdefault(key.scene, {})
        right, count = of_scene.get(key.seed, (0, 0))
        of_scene[key.seed] = (right + is_right, count + 1)
        self.likelihoods[key.scene] = scene_likelihood(self.difficulties[key.scene], of_scene)

    def ability(self) -> Ability:
        """Estimate the ability from the answers so far."""
        counts = (count for of_scene in self.answers.values() for _, count in of_scene.values())
        return posterior_ability(self.likelihoods.values(), sum(counts))

    def choose(self, count: int) -> list[tuple[EpisodeKey, Choice]]:
        """Choose the next episodes, each with its reason, and remove them from `waiting`.

        Args:
            count: Largest number of episodes; none is chosen if the test has ended.
        """
        now, chosen = self.ability(), list[tuple[EpisodeKey, Choice]]()
        played = Counter({scene: sum(count for _, count in found.values()) for scene, found in self.answers.items()})
        while len(chosen) < count and self.waiting and now.se > self.target:
            first: dict[int, EpisodeKey] = {}
            for key in self.waiting:
                first.setdefault(key.scene, key)
            scenes = list(first)
            found = information(
                [self.difficulties[one] for one in scenes], [played[one] for one in scenes], now.ability
            )
            ranked = sorted(zip(-found, scenes, strict=True))[:EXPOSED]
            draw = random.Random(f"{self.name}:{played.total()}")  # noqa: S311 - must be reproducible, not secret
            rank = draw.randrange(len(ranked))
            scene, difficulty = ranked[rank][1], self.difficulties[ranked[rank][1]]
            reason = Choice(
                ability=now.ability,
                se=now.se,
                information=float(-ranked[rank][0]),
                rank=rank + 1,
                difficulty=difficulty.logits,
                difficulty_se=difficulty.se,
                variant_sd=difficulty.variant_sd,
            )
            played[scene] += 1
            self.waiting.remove(first[scene])
            chosen.append((first[scene], reason))
        return chosen


_FAR = 2.0
"""Smallest distance from the average at which a scene is called far harder or far easier [logits]."""


@dataclass(frozen=True, slots=True)
class StatedDifficulty:
    """Calibrated difficulty of a scene."""

    logits: float
    se: float
    """Standard error [logits]."""
    right: int
    answers: int
    """Number of answers on which the difficulty rests, and how many of them are right."""
    takers: int
    """Number of takers of the whole calibration."""

    @property
    def word(self) -> str:
        """Difficulty compared with the average scene, such as `far harder`; `average or harder` if not significant."""
        side = "harder" if self.logits > 0 else "easier"
        if abs(self.logits) < QUANTILE * self.se:
            return f"average or {side}"
        return f"far {side}" if abs(self.logits) >= _FAR else side

    @property
    def figure(self) -> str:
        """Difficulty and standard error, such as `−2.4 ± 0.6`."""
        return f"{self.logits:+.1f} ± {self.se:.1f}".replace("-", "−")

    @property
    def sentence(self) -> str:
        """Sentences about the difficulty, for a documentation page."""
        than = "" if self.word.startswith("average") else " than the average scene"
        return (
            f"{self.figure} logits, {self.word}{than}. This rests on {self.answers} answers ({self.right} right) of"
            f" simulated takers: reference agents with handicaps, and baselines. No language model or person is among"
            f" the {self.takers} takers of the calibration."
        )


def stated_difficulties(packs: Iterable[PackFiles], file: Path = DIFFICULTIES) -> Mapping[int, StatedDifficulty]:
    """Return the difficulty of each pack whose present content was calibrated.

    Args:
        packs: The packs.
        file: A `calibration.json`.

    Raises:
        UsageError: The file cannot be read or is malformed.
    """
    found = read_calibration(file)
    by_scene = {one.scene: one for one in found.scenes}
    calibrated = ((files, by_scene[files.scene_id]) for files in packs if files.scene_id in by_scene)
    return {
        one.scene: StatedDifficulty(one.logits, one.se, one.right, one.answers, len(found.takers))
        for files, one in calibrated
        if same_pack(one.pack, files)
    }
