"""Plays the published logs again: their replies go through our text parser, tools and grader."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import anyio

from evaluator.agents.recorded import RepeatingPlayer
from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing
from evaluator.episode.protocols.text import parse_reply
from evaluator.errors import InfrastructureError
from evaluator.original.logs import LoggedEpisode
from evaluator.records.episode import Episode, EpisodeKey, Grade, Versions
from scenes import AnswerKind


@dataclass(frozen=True, slots=True)
class LogAgent:
    """Repeats a model's logged replies, turn by turn, and ignores the results."""

    log: LoggedEpisode

    @property
    def name(self) -> str:
        """The name of the model's folder."""
        return self.log.model

    def player(self, key: EpisodeKey, briefing: Briefing) -> RepeatingPlayer:
        """The player of the log."""
        del key, briefing
        return RepeatingPlayer([parse_reply(reply) for reply in self.log.replies], "the log ends here")


@dataclass(frozen=True, slots=True)
class PlayedLog:
    """A log, and the episode that its replies gave in our laboratory."""

    log: LoggedEpisode
    scene: int
    episode: Episode | None
    """None if the laboratory failed."""
    grade: Grade | None
    key: str | float | tuple[str | float, ...]
    is_choice: bool
    """Whether the key is compared exactly, for example the number of an object or option."""
    failure: str = ""


def scene_of(log: LoggedEpisode, names: Mapping[int, str]) -> int | None:
    """The scene of a log, by the title in its prompt or otherwise by its number; None if there is no such pack.

    The title comes first, because some published folders have the number of another scene.
    """
    if names.get(log.scene) == log.scene_name:
        return log.scene
    titled = [scene for scene, name in names.items() if name == log.scene_name]
    if len(titled) == 1:
        return titled[0]
    return log.scene if log.scene in names else None


async def play_logs(
    logs: Sequence[LoggedEpisode],
    laboratory: EpisodeConnector,
    keys: KeyRing,
    names: Mapping[int, str],
    *,
    versions: Callable[[int], Versions],
    jobs: int = 1,
    on_end: Callable[[PlayedLog], None] = lambda _: None,
) -> list[PlayedLog]:
    """Play logs, at most `jobs` at a time. Logs without a pack or without a reply are left out.

    Args:
        logs: The logs.
        laboratory: Serves the authors' packs.
        keys: The keys of the same packs.
        names: Scene → title, of the same packs.
        versions: Scene → versions to record.
        jobs: How many logs are played at a time.
        on_end: Called with each log when it has been played.
    """
    played: dict[int, PlayedLog] = {}
    waiting = iter(list(enumerate(_keyed(logs, names))))

    async def worker() -> None:
        for index, (log, key) in waiting:
            played[index] = await _play(log, key, laboratory, keys, versions(key.scene))
            on_end(played[index])

    async with anyio.create_task_group() as tasks:
        for _ in range(jobs):
            tasks.start_soon(worker)
    return [played[index] for index in sorted(played)]


def _keyed(logs: Sequence[LoggedEpisode], names: Mapping[int, str]) -> list[tuple[LoggedEpisode, EpisodeKey]]:
    """The logs that can be played, each with a unique key; a scene may have been played more than once."""
    keyed: list[tuple[LoggedEpisode, EpisodeKey]] = []
    epochs = Counter[EpisodeKey]()
    for log in logs:
        scene = scene_of(log, names)
        if scene is None or not log.replies:
            continue
        # A log may have one reply more than its budget, which the authors' program ignored.
        budget = max(log.budget, len(log.replies))
        key = EpisodeKey(scene=scene, seed=0, agent=log.model, budget=budget, protocol="text")
        epochs[key] += 1
        keyed.append((log, key.model_copy(update={"epoch": epochs[key]})))
    return keyed


async def _play(
    log: LoggedEpisode, key: EpisodeKey, laboratory: EpisodeConnector, keys: KeyRing, versions: Versions
) -> PlayedLog:
    answer_key = keys.key(key.scene, key.seed)
    is_choice = answer_key.spec.kind not in {AnswerKind.NUMBER, AnswerKind.NUMBERS}
    try:
        async with laboratory.open(key.scene, key.seed) as client:
            episode = await play_episode(LogAgent(log), client, key, versions, laboratory.toolboxes)
    except InfrastructureError as error:
        return PlayedLog(log, key.scene, None, None, answer_key.value, is_choice, str(error))
    return PlayedLog(log, key.scene, episode, grade_episode(episode, answer_key), answer_key.value, is_choice)
