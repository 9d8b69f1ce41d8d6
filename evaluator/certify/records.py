"""Certificates as records on disk: a check for each, with figures and, if it failed, reasons."""

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pydantic import Field

from evaluator.records import FORMAT, Record
from scenes import Pack

CERTIFICATES_FILE = "certificates.json"
"""Name of the file in a folder of packs."""
CERTIFICATES = ("key", "twins", "modality", "constant", "difficulty", "sane")
"""The certificates of every scene, in the order in which they are checked."""
PREDICTION_CERTIFICATES = ("unstageable", "tempting", "structure", "instrument")
"""The further certificates of scenes that ask for a prediction."""


class Check(Record):
    """One certificate of one scene."""

    name: str
    passed: bool
    reasons: tuple[str, ...] = ()
    """Why it failed, one sentence for each reason."""
    figures: Mapping[str, float | int | str | list[str]] = Field(
        default_factory=dict[str, float | int | str | list[str]]
    )
    """Name → measured value."""


class SceneCertificate(Record):
    """All certificates of one scene."""

    scene: int
    name: str
    category: str
    pack: str
    """Hash of the certified pack."""
    seeds: int
    """Number of seeds it was certified on, from 0 on."""
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)


class Certificates(Record):
    """`certificates.json`."""

    format: Literal[1] = FORMAT
    engine: str
    """Version of MuJoCo used."""
    scenes: tuple[SceneCertificate, ...]


def certificates_of(pack: Pack) -> tuple[str, ...]:
    """The certificates that a pack needs, in the order in which they are checked."""
    return CERTIFICATES + (PREDICTION_CERTIFICATES if pack.predicts else ())


def check(name: str, reasons: list[str], **figures: float | str | list[str]) -> Check:
    """A check that passed if there are no reasons; figures are rounded to four significant digits."""
    rounded = {key: float(f"{value:.4g}") if isinstance(value, float) else value for key, value in figures.items()}
    return Check(name=name, passed=not reasons, reasons=tuple(reasons), figures=rounded)


def read_certificates(folder: Path) -> Certificates | None:
    """The certificates stored in a folder of packs; None if the file is missing or cannot be read."""
    try:
        return Certificates.model_validate_json((folder / CERTIFICATES_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
