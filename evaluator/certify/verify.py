"""Certifies many scenes in parallel processes with one shared host; reads and writes the certificates file."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path

import anyio

from evaluator.certify.certificate import certify
from evaluator.certify.parallel import in_processes
from evaluator.certify.records import (
    Certificates,
    SceneCertificate,
    certificates_of,
    file_for,
    read_certificates,
)
from evaluator.episode.connect import HostConnector
from evaluator.errors import StoreError
from scenes import PackError, PackFiles, list_packs, pack_hash, read_pack


async def verify(
    packs: Sequence[PackFiles], seeds: int, jobs: int, host: str, on_done: Callable[[SceneCertificate], None]
) -> list[SceneCertificate]:
    """Certify scenes in parallel processes.

    Args:
        packs: The scenes.
        seeds: Number of seeds for each scene, from 0 on.
        jobs: Number of processes.
        host: Address of the host on which the reference protocols are played.
        on_done: Called with each certificate when it is ready.

    Returns:
        The certificates, ordered by scene id.

    Raises:
        InfrastructureError: The host failed.
    """
    proven = dict[int, SceneCertificate]()

    def done(files: PackFiles, certificate: SceneCertificate) -> None:
        proven[files.scene_id] = certificate
        on_done(certificate)

    await in_processes(packs, lambda files: partial(_certify_here, files, seeds, host), jobs, done)
    return [proven[scene] for scene in sorted(proven)]


def _certify_here(files: PackFiles, seeds: int, host: str) -> SceneCertificate:
    return anyio.run(certify, files, seeds, HostConnector(host))


def still_proven(folder: Path, packs: Sequence[PackFiles], seeds: int) -> list[SceneCertificate]:
    """The stored certificates that need not be made again: of sound packs, unchanged, on as many seeds or more.

    A certificate that was made with another engine than the one installed, or that lacks a check, does not count.
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

    Scenes that were not certified now keep their stored certificate. So does a scene whose stored certificate proves
    the same on more seeds.

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
        # Written beside it first: a process that is killed now must not leave half a file.
        part.write_text(certificates.model_dump_json(indent=1) + "\n", encoding="utf-8")
        part.replace(file)
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror}") from error
    return file


def _proves_more(stored: SceneCertificate | None, new: SceneCertificate) -> bool:
    """Whether a stored certificate proves what the new one does, on more seeds."""
    return (
        stored is not None
        and (stored.passed, stored.pack) == (new.passed, new.pack) == (True, stored.pack)
        and stored.seeds > new.seeds
        and {check.name for check in stored.checks} >= {check.name for check in new.checks}
    )
