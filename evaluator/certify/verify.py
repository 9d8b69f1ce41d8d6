"""Checks the certificates of scenes in parallel processes, with episodes over MCP and runs of the engine."""

import contextlib
from collections.abc import AsyncGenerator, Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import anyio
from mcp import Client

from evaluator.agents.reference import ReferenceAgent
from evaluator.certify import compiled_model
from evaluator.certify.attempts import check_structure, check_tempting, check_unstageable
from evaluator.certify.determined import check_determined
from evaluator.certify.difficulty import check_difficulty
from evaluator.certify.holds import check_holds
from evaluator.certify.keys import check_constant, check_instrument, check_key
from evaluator.certify.lint import lint
from evaluator.certify.processes import in_processes
from evaluator.certify.records import CERTIFICATES, Check, SceneCertificate, certificates_of, check
from evaluator.certify.subject import Subject
from evaluator.certify.twins import check_modality, check_twins
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.hosts import HostConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import InfrastructureError
from evaluator.records.episode import Episode, EpisodeKey, Versions
from physment_mcp import open_episode
from scenes import PackError, PackFiles, pack_hash


@dataclass(frozen=True, slots=True)
class MemoryConnector:
    """Opens episodes of the packs in a folder over MCP in memory."""

    folder: Path | None = None
    toolboxes: Toolboxes = field(default_factory=Toolboxes, repr=False, compare=False)

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Open a new episode and yield a client connected to it."""
        server = open_episode(scene, seed, scenes_dir=self.folder).server()
        async with Client(server, cache=None) as client:
            yield client


BUDGET = 20
_SANE_SEEDS = 3
_WIRED_SEEDS = 4
"""Number of seeds that are played on the given laboratory; the others are played in memory."""


async def certify(files: PackFiles, seeds: int, laboratory: EpisodeConnector) -> SceneCertificate:
    """Check all certificates of a scene.

    Args:
        files: The pack of the scene. Its `solution.py` is executed.
        seeds: Number of seeds, from 0 on.
        laboratory: Laboratory on which the reference protocol is played on the first seeds. On the others, the same
            server and client are connected in memory, because sockets would take most of the time.

    Raises:
        InfrastructureError: The laboratory failed.
    """
    faults = lint(files)
    try:
        subject = Subject.open(files)
    except PackError as error:
        reason = [*faults, str(error)]
        return _certificate(files, seeds, "", "", [check(name, reason) for name in CERTIFICATES])
    category = subject.pack.category
    assert category is not None
    checks: list[Check] = []
    try:
        memory = MemoryConnector(files.folder.parent)
        places = [laboratory if seed < _WIRED_SEEDS else memory for seed in range(seeds)]
        episodes = [await play_reference(subject, seed, place) for seed, place in enumerate(places)]
        checks = [
            check_key(subject, episodes),
            await check_twins(subject, episodes),
            await check_modality(subject),
            check_constant(subject),
            await check_difficulty(subject, episodes),
            check_sane(subject, range(min(seeds, _SANE_SEEDS)), faults),
        ]
        if subject.pack.predicts:
            checks += [
                await check_unstageable(subject, seeds),
                check_tempting(subject, seeds),
                check_structure(subject, episodes),
                check_instrument(subject, episodes),
            ]
        if subject.pack.catches:
            checks.append(check_holds(subject, seeds))
        if subject.pack.family:
            checks.append(check_determined(subject, episodes))
    except InfrastructureError:
        raise
    except Exception as error:  # noqa: BLE001 - the pack's own code ran; any exception is a reason
        checks = [check(name, [f"solution.py failed: {error!r}"]) for name in certificates_of(subject.pack)]
    return _certificate(files, seeds, subject.pack.metadata.scene_name, category.value, checks)


def check_sane(subject: Subject, seeds: Iterable[int], faults: Sequence[str]) -> Check:
    """Certificate 6: lint finds no fault, initial contacts are not deep, and energy does not increase.

    Args:
        subject: The scene.
        seeds: Seeds whose models are run.
        faults: Faults that lint found.
    """
    reasons = list(faults)
    drawn = [subject.draw(seed).mjcf for seed in seeds]
    depth = max(compiled_model.deepest_contact(mjcf) for mjcf in drawn)
    gain = max(compiled_model.energy_gain(mjcf) for mjcf in drawn)
    if depth > compiled_model.DEEPEST_M:
        reasons.append(f"a contact is {1000 * depth:.2g} mm deep at the start; at most 1 mm may be")
    if gain > 1:
        reasons.append("untouched for 10 s the scene gains mechanical energy")
    return check("sane", reasons, deepest_contact_m=depth)


async def play_reference(subject: Subject, seed: int, laboratory: EpisodeConnector) -> Episode:
    """Play the reference agent's episode in a scene at a seed."""
    key = EpisodeKey(scene=subject.files.scene_id, seed=seed, agent="reference", budget=BUDGET)
    agent = ReferenceAgent(subject.files.folder.parent)
    async with laboratory.open(subject.files.scene_id, seed) as client:
        versions = Versions(physment="", protocol="", pack="")
        return await play_episode(agent, client, key, versions, laboratory.toolboxes)


def _certificate(files: PackFiles, seeds: int, name: str, category: str, checks: Sequence[Check]) -> SceneCertificate:
    return SceneCertificate(
        scene=files.scene_id, name=name, category=category, pack=pack_hash(files), seeds=seeds, checks=tuple(checks)
    )


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
