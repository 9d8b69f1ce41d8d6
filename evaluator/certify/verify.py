"""Certificates of many scenes: processes side by side, one warm host, and the file they end in."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib.metadata import version
from pathlib import Path

import anyio
from anyio import to_process

from evaluator.certify.certificate import certify
from evaluator.certify.records import CERTIFICATES_FILE, Certificates, SceneCertificate, read_certificates
from evaluator.episode.connect import HostLaboratory
from evaluator.errors import StoreError
from scenes import PackFiles, list_packs


async def verify(
    packs: Sequence[PackFiles], seeds: int, jobs: int, host: str, on_done: Callable[[SceneCertificate], None]
) -> list[SceneCertificate]:
    """Certify scenes, `jobs` at a time, each in a process of its own.

    Args:
        packs: The scenes.
        seeds: On how many seeds each, from 0 on.
        jobs: How many processes.
        host: Address of the host on which the reference protocols are played.
        on_done: Told of each certificate as it comes.

    Returns:
        The certificates by ascending id.

    Raises:
        InfrastructureError: The host failed.
    """
    limiter, proven = anyio.CapacityLimiter(jobs), dict[int, SceneCertificate]()

    async def one(files: PackFiles) -> None:
        work = partial(_certify_here, files, seeds, host)
        certificate = await to_process.run_sync(work, cancellable=True, limiter=limiter)
        proven[files.scene_id] = certificate
        on_done(certificate)

    async with anyio.create_task_group() as tasks:
        for files in packs:
            tasks.start_soon(one, files)
    return [proven[scene] for scene in sorted(proven)]


def _certify_here(files: PackFiles, seeds: int, host: str) -> SceneCertificate:
    return anyio.run(certify, files, seeds, HostLaboratory(host))


def write_certificates(folder: Path, proven: Iterable[SceneCertificate]) -> Path:
    """Write `certificates.json` into a folder of packs; scenes not proven now keep what the file said of them.

    What was proven with another version of the engine is not kept.

    Raises:
        StoreError: The file cannot be written.
    """
    file, engine = folder / CERTIFICATES_FILE, version("mujoco")
    before = read_certificates(folder)
    kept = before.scenes if before and before.engine == engine else ()
    present = {files.scene_id for files in list_packs(folder)}
    scenes = {one.scene: one for one in (*kept, *proven) if one.scene in present}
    certificates = Certificates(engine=engine, scenes=tuple(scenes[scene] for scene in sorted(scenes)))
    try:
        file.write_text(certificates.model_dump_json(indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror}") from error
    return file
