"""Certificates as records on disk: for each check its result, figures and, if it failed, reasons."""

from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Literal

from pydantic import Field

from evaluator.errors import StoreError
from evaluator.records.episode import FORMAT, Record
from scenes import Pack, PackError, PackFiles, list_packs, pack_hash, read_pack

CERTIFICATES_FILE = "certificates.json"
"""Name of the file in a folder of packs; for a second engine, see `file_for`."""
CERTIFICATES = ("key", "twins", "modality", "constant", "difficulty", "sane")
"""The certificates of every scene, in the order in which they are checked."""
PREDICTION_CERTIFICATES = ("unstageable", "tempting", "structure", "instrument")
"""Additional certificates of scenes that ask for a prediction."""
FAMILY_CERTIFICATES = ("determined",)
"""Additional certificates of scenes whose pack names the family of laws that its task states."""

CATCH_CERTIFICATES = ("holds",)
"""Additional certificate of scenes that name a catch."""


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
    """Hash of the certified pack's content."""
    seeds: int
    """Number of seeds on which the scene was certified, from 0 on."""
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)


class Certificates(Record):
    """Content of `certificates.json`, or of the file for another version of the engine."""

    format: Literal[1] = FORMAT
    engine: str
    """Version of MuJoCo for which the certificates hold."""
    scenes: tuple[SceneCertificate, ...]


def certificates_of(pack: Pack) -> tuple[str, ...]:
    """Return the names of the certificates that a pack needs, in the order in which they are checked."""
    return (
        CERTIFICATES
        + (PREDICTION_CERTIFICATES if pack.predicts else ())
        + (CATCH_CERTIFICATES if pack.catches else ())
        + (FAMILY_CERTIFICATES if pack.family else ())
    )


def check(name: str, reasons: list[str], **figures: float | str | list[str]) -> Check:
    """Return a check that passed if there are no reasons; figures are rounded to four significant digits."""
    rounded = {key: float(f"{value:.4g}") if isinstance(value, float) else value for key, value in figures.items()}
    return Check(name=name, passed=not reasons, reasons=tuple(reasons), figures=rounded)


def file_for(folder: Path, engine: str) -> Path:
    """Path of the certificates of a folder of packs for a version of the engine. The file need not exist.

    The first engine uses `certificates.json`. Every other version has its own file, such as `certificates-4.0.0.json`,
    so that certifying on one engine never replaces the certificates of another.
    """
    first = read_certificates(folder)
    other = first is not None and first.engine != engine
    return folder / (f"certificates-{engine}.json" if other else CERTIFICATES_FILE)


def read_certificates(folder: Path, engine: str | None = None) -> Certificates | None:
    """Read the certificates stored in a folder of packs; None if the file is missing or unreadable.

    Args:
        folder: Folder of packs.
        engine: Version of MuJoCo that the certificates must be for; None for that of `certificates.json`.
    """
    file = folder / CERTIFICATES_FILE if engine is None else file_for(folder, engine)
    try:
        stored = Certificates.model_validate_json(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return stored if engine in {None, stored.engine} else None


def engine_note(folder: Path) -> str:
    """Return a note if the scenes are certified, but not for the installed engine; otherwise empty."""
    stored, engine = read_certificates(folder), version("mujoco")
    if stored is None or read_certificates(folder, engine) is not None:
        return ""
    return (
        f"the certificates of these scenes hold on MuJoCo {stored.engine}, but {engine} is installed here; results"
        f" compare only with others on {engine}"
    )


def still_proven(folder: Path, packs: Sequence[PackFiles], seeds: int) -> list[SceneCertificate]:
    """Return the stored certificates that passed, on at least `seeds` seeds, for packs that have not changed since.

    A certificate that lacks a check, or was made with another version of the engine, is not valid.
    """
    stored = read_certificates(folder, version("mujoco"))
    if stored is None:
        return []
    certificates = {certificate.scene: certificate for certificate in stored.scenes}
    return [
        certificate
        for files in packs
        if (certificate := certificates.get(files.scene_id)) is not None
        and certificate.passed
        and certificate.seeds >= seeds
        and certificate.pack == pack_hash(files)
        and tuple(check.name for check in certificate.checks) == _needed(files)
    ]


def _needed(files: PackFiles) -> tuple[str, ...]:
    try:
        return certificates_of(read_pack(files))
    except PackError:
        return ()


def write_certificates(folder: Path, proven: Iterable[SceneCertificate]) -> Path:
    """Write the certificates of the installed engine into a folder of packs; see `file_for`.

    Scenes that are not in `proven` keep their stored certificates. So do scenes whose stored certificate
    has passed the same checks on more seeds.

    Raises:
        StoreError: The file cannot be written.
    """
    engine = version("mujoco")
    file = file_for(folder, engine)
    part = file.with_name(f"{file.name}.part")
    before = read_certificates(folder, engine)
    kept = before.scenes if before else ()
    present = {files.scene_id for files in list_packs(folder)}
    scenes = {certificate.scene: certificate for certificate in kept if certificate.scene in present}
    for certificate in proven:
        if certificate.scene in present and not _proves_more(scenes.get(certificate.scene), certificate):
            scenes[certificate.scene] = certificate
    certificates = Certificates(engine=engine, scenes=tuple(scenes[scene] for scene in sorted(scenes)))
    try:
        # Write to a temporary file first, so that a kill cannot leave a partial file.
        part.write_text(certificates.model_dump_json(indent=1) + "\n", encoding="utf-8")
        part.replace(file)
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror}") from error
    return file


def _proves_more(stored: SceneCertificate | None, new: SceneCertificate) -> bool:
    """Return whether a stored certificate of the same pack has passed the same checks on more seeds."""
    return (
        stored is not None
        and (stored.passed, stored.pack) == (new.passed, new.pack) == (True, stored.pack)
        and stored.seeds > new.seeds
        and {check.name for check in stored.checks} >= {check.name for check in new.checks}
    )
