"""Functions of the public interface: play an episode, grade it, score it, load a run folder, read a split.

They do the same as the commands, but write no files, print nothing and do not retry.
"""

import functools
import operator
from collections.abc import Iterable
from contextlib import AbstractAsyncContextManager, nullcontext
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import SupportsIndex

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
    """The contents of a run folder."""

    record: RunRecord
    """Contents of `run.json`: the settings that determine the results."""
    episodes: tuple[Episode, ...]
    grades: dict[EpisodeKey, GradeRecord]
    """Stored grades; empty for a run that has not been graded."""


def connect(server: str = "host", scenes_dir: Path | None = None) -> AbstractAsyncContextManager[EpisodeConnector]:
    """Open a laboratory on which many episodes are played; an asynchronous context manager.

    Args:
        server: `host` for a local episode server, `stdio` for a server process per episode, the URL of an episode
            server, or a command.
        scenes_dir: Folder of scene packs for servers that this function starts; the suite by default.

    Raises:
        UsageError: On entering: `server` has none of these forms, or an episode server does not start.
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
        agent: The agent that plays. Its exceptions propagate to the caller.
        scene: Id of the scene.
        seed: 0 for the scene as written, any other number for a variant.
        budget: Number of iterations that the agent may use.
        prompting: `zero-shot`, `one-shot-cot` or `few-shot-cot`: the number of worked examples in the prompt.
        server: A value that `connect` accepts, or an open laboratory that it returned.
        scenes_dir: Folder of scene packs; the suite by default.

    Returns:
        The episode, as a run folder would store it. It is not graded.

    Raises:
        UsageError: There is no such scene, or `server` is malformed.
        InfrastructureError: The server failed.
    """
    versions = _versions(scene, scenes_dir)
    key = EpisodeKey(scene=scene, seed=seed, agent=agent.name, budget=budget, prompting=prompting)
    connected = connect(server, scenes_dir) if isinstance(server, str) else nullcontext(server)
    async with connected as laboratory, laboratory.open(scene, seed) as client:
        versions = versions.model_copy(update={"protocol": client.protocol_version})
        return await play_episode(agent, client, key, versions, laboratory.toolboxes)


def episode_of_log(log: bytes, scene: int, *, seed: int = 0, max_calls: int, scenes_dir: Path | None = None) -> Episode:
    """Build the episode that an external program played, from the call log of its episode server.

    Args:
        log: The response of `GET /episodes/ID/calls`, with the calls of all pages.
        scene: Id of the scene.
        seed: Variant of the scene.
        max_calls: Limit on tool calls.
        scenes_dir: Folder of scene packs; the suite by default.

    Returns:
        The episode, with one turn per call. Without an answer its outcome is `budget_exhausted`. Its prompt, the
        version of MCP and its start time are empty, because a log does not contain them.

    Raises:
        UsageError: `log` is not such a log, or there is no such scene.
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
    """Return the versions that determine the result of an episode; the version of MCP is left empty.

    Raises:
        UsageError: There is no such scene.
    """
    try:
        pack = pack_hash(find_pack(scene, scenes_dir))
    except PackError as error:
        raise UsageError(str(error)) from error
    return Versions(physment=version("physment-mcp"), protocol="", pack=pack)


def grade(episode: Episode, scenes_dir: Path | None = None) -> GradeRecord:
    """Compare the answer of an episode with the answer key of its scene and seed.

    Args:
        episode: An episode that was played or loaded.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: The pack is missing, or has no key for this seed.
    """
    return grade_record(episode, KeyRing(scenes_dir))


def reward(scene: int, seed: int, answer: JsonValue, scenes_dir: Path | None = None) -> AnswerReward:
    """Return the reward of an answer, for a training loop that plays in its own process.

    Answer keys are cached, so a second request for the same variant takes about 0.1 ms.

    Args:
        scene: Id of the scene.
        seed: Variant of the scene.
        answer: The agent's answer, unchanged, for example `OpenEpisode.answer`; None if it gave none.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: There is no such scene, the seed is no integer from 0 on, or the scene has no key for this seed.
    """
    return answer_reward(answer, _keys(scenes_dir).key(scene, _checked_seed(seed)))


def _checked_seed(seed: object) -> int:
    """Return the seed as an int. Refuse other values, such as 1.5: no server opens the variants of such seeds."""
    # Integers of numpy are no instances of int.
    if isinstance(seed, bool) or not isinstance(seed, SupportsIndex) or operator.index(seed) < 0:
        raise UsageError(f"the seed must be an integer from 0 on, not {seed!r}")
    return operator.index(seed)


@functools.cache
def _keys(scenes_dir: Path | None) -> KeyRing:
    return KeyRing(scenes_dir)


def score(episodes: Iterable[Episode], scenes_dir: Path | None = None) -> list[ScoredEpisode]:
    """Grade episodes and compute their scores, grounding and failures.

    Args:
        episodes: Episodes that were played or loaded.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: A pack is missing, or has no key for a seed.
    """
    keys = KeyRing(scenes_dir)
    return [score_episode(episode, grade_record(episode, keys), keys) for episode in episodes]


def summary(rows: Iterable[ScoredEpisode]) -> RunSummary:
    """Summarise several episodes: accuracies with intervals, dimensions, Final Score, budget curves."""
    return summarise(list(rows))


def split(name: str) -> Split:
    """Return the scenes and seeds of a split, for programs that train or test an agent.

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
