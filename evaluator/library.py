"""What a program that imports `evaluator` calls: play an episode, grade it, score it, load a run folder, name a split.

These functions do what the commands do, without files, printing or retries.
"""

import functools
from collections.abc import Iterable
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

from pydantic import JsonValue, ValidationError

from evaluator.agents.external.watched import outcome_of, turns_of_log
from evaluator.answers.keys import KeyRing
from evaluator.answers.rewards import AnswerReward, answer_reward
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.connect import connect as laboratory_at
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, GradeRecord, Outcome, Versions
from evaluator.records.run import RunRecord
from evaluator.scores.metrics import RunSummary, summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.scoring import grade_record, score_episode
from evaluator.store.run_folder import RunFolder
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


def connect(server: str = "host", scenes_dir: Path | None = None) -> AbstractAsyncContextManager[EpisodeConnector]:
    """Open a laboratory on which many episodes are played; an asynchronous context manager.

    Args:
        server: `host` for a local host, `stdio` for a server process for each episode, the URL of a host, or a command.
        scenes_dir: Folder of scene packs for servers that this starts; the suite by default.

    Raises:
        UsageError: When it is entered: `server` cannot be understood, or a host does not start.
    """
    return laboratory_at(server, scenes_dir)


async def play(
    agent: Agent,
    scene: int,
    *,
    seed: int = 0,
    budget: int = 20,
    prompting: str = "zero-shot",
    server: str | EpisodeConnector = "stdio",
    scenes_dir: Path | None = None,
) -> Episode:
    """Play one episode.

    Args:
        agent: Plays. Its exceptions reach the caller.
        scene: Id of the scene.
        seed: 0 for the scene as written, any other number for a variant.
        budget: Iterations that the agent may use.
        prompting: `zero-shot`, `one-shot-cot` or `few-shot-cot`: how many worked examples the prompt shows.
        server: What `connect` takes or returns.
        scenes_dir: Folder of scene packs; the suite by default.

    Returns:
        The episode as a run folder would hold it. It is not graded.

    Raises:
        UsageError: There is no such scene, or `server` cannot be understood.
        InfrastructureError: The server failed.
    """
    versions = _versions(scene, scenes_dir)
    key = EpisodeKey(scene=scene, seed=seed, agent=agent.name, budget=budget, prompting=prompting)
    connected = connect(server, scenes_dir) if isinstance(server, str) else nullcontext(server)
    async with connected as laboratory, laboratory.open(scene, seed) as client:
        versions = versions.model_copy(update={"protocol": client.protocol_version})
        return await play_episode(agent, client, key, versions, laboratory.toolboxes)


def episode_of_log(log: bytes, scene: int, *, seed: int = 0, max_calls: int, scenes_dir: Path | None = None) -> Episode:
    """The episode of a program that drove itself, from the log of calls that its host kept.

    Args:
        log: What `GET /episodes/ID/calls` returned, with the calls of all pages.
        scene: Id of the scene.
        seed: Variant of the scene.
        max_calls: Tool calls that the program might make.
        scenes_dir: Folder of scene packs; the suite by default.

    Returns:
        The episode, a turn for each call. Without an answer its outcome is `budget_exhausted`. Its prompt, the version
        of MCP and the time of its start are empty, since a log does not tell them.

    Raises:
        UsageError: It is no such log, or there is no such scene.
    """
    try:
        turns = turns_of_log(log)
    except ValidationError as error:
        raise UsageError(f"this is no log of calls: {error.errors()[0]['msg']}") from error
    outcome, answer = outcome_of(turns, max_calls)
    return Episode(
        key=EpisodeKey(scene=scene, seed=seed, agent="external", budget=max_calls),
        outcome=outcome or Outcome.BUDGET_EXHAUSTED,
        answer=answer,
        prompt="",
        turns=turns,
        max_calls=max_calls,
        started_at="",
        duration_s=sum(turn.agent_s + turn.server_s for turn in turns),
        versions=_versions(scene, scenes_dir),
    )


def _versions(scene: int, scenes_dir: Path | None) -> Versions:
    """The versions that decide the result of an episode, without that of MCP.

    Raises:
        UsageError: There is no such scene.
    """
    try:
        pack = pack_hash(find_pack(scene, scenes_dir))
    except PackError as error:
        raise UsageError(str(error)) from error
    return Versions(physment=version("physment-mcp"), protocol="", pack=pack)


def grade(episode: Episode, scenes_dir: Path | None = None) -> GradeRecord:
    """Compare the answer of an episode with the key of its scene and seed.

    Args:
        episode: As played or loaded.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: The pack is missing or gives no key.
    """
    return grade_record(episode, KeyRing(scenes_dir))


def reward(scene: int, seed: int, answer: JsonValue, scenes_dir: Path | None = None) -> AnswerReward:
    """What an answer is worth: the reward of a training loop that plays in its own process.

    Keys are kept, so asking again for the same variant takes some 0.1 ms.

    Args:
        scene: Id of the scene.
        seed: Variant of the scene.
        answer: As the agent gave it, for example `OpenEpisode.answer`; None for an episode without one.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: There is no such scene, or it gives no key for this seed.
    """
    return answer_reward(answer, _keys(scenes_dir).key(scene, seed))


@functools.cache
def _keys(scenes_dir: Path | None) -> KeyRing:
    return KeyRing(scenes_dir)


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
