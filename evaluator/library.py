"""What a program that imports `evaluator` calls: play an episode, grade it, score it, load a run folder, name a split.

These functions do what the commands do, without files, printing or retries.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import connect
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent
from evaluator.errors import UsageError
from evaluator.records import Episode, EpisodeKey, GradeRecord, Versions
from evaluator.run_record import RunRecord
from evaluator.scores.metrics import RunSummary, summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.scoring import grade_record, score_episode
from evaluator.store import RunFolder
from evaluator.study.selection import find_split
from scenes import PackError, find_pack, pack_hash
from scenes.splits import Split


@dataclass(frozen=True, slots=True)
class StoredRun:
    """A run folder that was read."""

    record: RunRecord
    """Contents of `run.json`: what decides the results."""
    episodes: tuple[Episode, ...]
    grades: dict[EpisodeKey, GradeRecord]
    """Stored grades; empty for a run that has not been graded."""


async def play(
    agent: Agent,
    scene: int,
    *,
    seed: int = 0,
    budget: int = 20,
    server: str = "stdio",
    scenes_dir: Path | None = None,
) -> Episode:
    """Play one episode.

    Args:
        agent: Plays. Its exceptions reach the caller.
        scene: Id of the scene.
        seed: 0 for the scene as written, any other number for a variant.
        budget: Iterations that the agent may use.
        server: `stdio` for a server process of its own, `host` for a local host, the URL of a host, or a command.
        scenes_dir: Folder of scene packs; the suite by default.

    Returns:
        The episode as a run folder would hold it. It is not graded.

    Raises:
        UsageError: There is no such scene, or `server` cannot be understood.
        InfrastructureError: The server failed.
    """
    try:
        pack = pack_hash(find_pack(scene, scenes_dir))
    except PackError as error:
        raise UsageError(str(error)) from error
    key = EpisodeKey(scene=scene, seed=seed, agent=agent.name, budget=budget)
    async with connect(server, scenes_dir) as laboratory, laboratory.open(scene, seed) as client:
        versions = Versions(physment=version("physment-mcp"), protocol=client.protocol_version, pack=pack)
        return await play_episode(agent, client, key, versions, laboratory.toolboxes)


def grade(episode: Episode, scenes_dir: Path | None = None) -> GradeRecord:
    """Compare the answer of an episode with the key of its scene and seed.

    Args:
        episode: As played or loaded.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: The pack is missing or gives no key.
    """
    return grade_record(episode, KeyRing(scenes_dir))


def score(episodes: Iterable[Episode], scenes_dir: Path | None = None) -> list[ScoredEpisode]:
    """Grade episodes and compute their scores, grounding and failures.

    Args:
        episodes: As played or loaded.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: A pack is missing or gives no key.
    """
    keys = KeyRing(scenes_dir)
    return [score_episode(episode, grade_record(episode, keys), keys) for episode in episodes]


def summary(rows: Iterable[ScoredEpisode]) -> RunSummary:
    """The numbers of several episodes: accuracies with intervals, dimensions, Final Score, budget curves."""
    return summarise(list(rows))


def split(name: str) -> Split:
    """The scenes and seeds of a split, for programs that train or test an agent.

    Args:
        name: `train`, `validation`, `test`, or one of the further splits that `scenes.splits` lists.

    Raises:
        UsageError: There is no such split, or its seeds are held back.
    """
    return find_split(name)


def load_run(folder: Path | str) -> StoredRun:
    """Read a run folder.

    Raises:
        StoreError: The folder holds no run, or a record cannot be read.
    """
    stored = RunFolder(Path(folder))
    return StoredRun(stored.read_run(), tuple(stored.episodes().values()), stored.grades())
