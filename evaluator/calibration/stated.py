"""Describes the calibrated difficulties of scenes in words, for lists and pages of scenes."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from evaluator.calibration.adaptive import DIFFICULTIES, read_calibration
from evaluator.records.calibration import QUANTILE
from scenes import PackFiles, same_pack

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
