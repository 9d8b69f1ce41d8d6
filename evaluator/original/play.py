"""Replays the published logs with this project's parser, tools and grader, and explains differences of verdicts."""

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import anyio
from pydantic import JsonValue

from evaluator.agents.recorded import RepeatingPlayer
from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing
from evaluator.episode.protocols.text import parse_reply
from evaluator.errors import InfrastructureError
from evaluator.original.logs import LoggedEpisode, LoggedVerdict
from evaluator.records.episode import Episode, EpisodeKey, Grade, Versions
from scenes import AnswerKind

_REL_TOL = 0.05
"""Tolerance of Eq. 1 of the paper: a number is right within 5 % of the key."""
_THEIR_ABS_TOL = 0.1
"""Absolute tolerance that the authors' program applies instead."""
_SEPARATORS = re.compile(r"[,;\s]+")


class Disagreement(StrEnum):
    """Reason why the logged verdict and this project's verdict on an answer differ."""

    OTHER_ANSWER = "another answer was read from the reply"
    SAME_TEXT = "the very text of the key, marked wrong"
    TOLERANCE = "within 5 % of the key, marked wrong"
    WORDING = "strictly right in words, marked wrong"
    FORM = "right by normalised grading only, marked wrong"
    FORGIVEN = "right by normalised grading only, marked right"
    SIGN = "wrong sign, marked right"
    PART = "a part of the key, marked right"
    MORE = "more values than the key has, marked right"
    FAR = "more than 5 % off but within 0.1, marked right"
    WORDS = "words, for a key that is in numbers now, marked right"
    OTHER_KEY = "marked right, though no rule matches it with this key"


class Eq1Disagreement(StrEnum):
    """Reason why Eq. 1 and this project's strict verdict differ."""

    CHOICE = "a number near one that stands for a choice"
    ZERO = "a key of 0, of which 5 % is nothing"
    UNEXPLAINED = "unexplained"


def eq1(answer: JsonValue, key: JsonValue) -> bool | None:
    """Whether every number of an answer is right by Eq. 1, |â - a| ≤ 0.05 |a|; None if a value is not a number."""
    got, want = numbers(answer), numbers(key)
    if got is None or want is None:
        return None
    return len(got) == len(want) and all(abs(a - b) <= _REL_TOL * abs(b) for a, b in zip(got, want, strict=True))


def numbers(value: JsonValue) -> list[float] | None:
    """Return the numbers in a value or list; None if it contains anything else."""
    if isinstance(value, list):
        parts = [numbers(item) for item in value]
        return None if any(part is None or len(part) != 1 for part in parts) else [part[0] for part in parts if part]
    written = [part for part in _SEPARATORS.split(str(value).strip(" \t\r\n[]()")) if part]
    try:
        found = [float(part) for part in written]
    except ValueError:
        return None
    return found if found and all(map(math.isfinite, found)) else None


def why_other_verdict(
    logged: LoggedVerdict, answer: JsonValue, key: JsonValue, *, strict: bool, normalised: bool
) -> Disagreement | None:
    """Explain why a logged verdict differs from this project's; None if it does not.

    Args:
        logged: The verdict and the answer in the log.
        answer: The answer that this project parsed from the same replies; None if there was none.
        key: The answer key of the pack.
        strict: This project's strict verdict.
        normalised: This project's normalised verdict.
    """
    if logged.right == strict == (strict or normalised):
        return None
    if not _same_answer(logged.answer, answer):
        return Disagreement.OTHER_ANSWER
    if normalised and not strict:
        return Disagreement.FORGIVEN if logged.right else Disagreement.FORM
    got, want = numbers(logged.answer), numbers(key)
    if logged.right:
        return Disagreement.WORDS if got is None else _why_marked_right(got, want or [])
    if _plain(logged.answer) == _plain(logged.key):
        return Disagreement.SAME_TEXT
    return Disagreement.WORDING if got is None else Disagreement.TOLERANCE


def _why_marked_right(got: list[float], want: list[float]) -> Disagreement:
    if len(got) < len(want):
        return Disagreement.PART
    if len(got) > len(want):
        return Disagreement.MORE
    if eq1([abs(number) for number in got], [abs(number) for number in want]):
        return Disagreement.SIGN
    near = all(abs(a - b) < _THEIR_ABS_TOL for a, b in zip(got, want, strict=True))
    return Disagreement.FAR if near else Disagreement.OTHER_KEY


def why_other_than_eq1(by_eq1: bool, strict: bool, key: JsonValue, *, is_choice: bool) -> Eq1Disagreement | None:
    """Explain why the strict verdict differs from that of Eq. 1; None if it does not."""
    if by_eq1 == strict:
        return None
    if is_choice:
        return Eq1Disagreement.CHOICE
    return Eq1Disagreement.ZERO if 0 in (numbers(key) or []) else Eq1Disagreement.UNEXPLAINED


def _same_answer(logged: str, answer: JsonValue) -> bool:
    """Return whether the logged answer, which Python's `str` formatted, equals the answer that was parsed here."""
    if answer is None:
        return logged == "None"
    return _plain(logged) == _plain(answer) or (numbers(logged) is not None and numbers(logged) == numbers(answer))


def _plain(value: JsonValue) -> str:
    text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
    return re.sub(r"\s+", "", text.strip(" []()")).lower()


@dataclass(frozen=True, slots=True)
class LogAgent:
    """Replays a model's logged replies, turn by turn, and ignores the results of its calls."""

    log: LoggedEpisode

    @property
    def name(self) -> str:
        """Name of the model's folder."""
        return self.log.model

    def player(self, key: EpisodeKey, briefing: Briefing) -> RepeatingPlayer:
        """Return a player that replays the log."""
        del key, briefing
        return RepeatingPlayer([parse_reply(reply) for reply in self.log.replies], "the log ends here")


@dataclass(frozen=True, slots=True)
class PlayedLog:
    """A log, and the episode that its replies gave on this project's server."""

    log: LoggedEpisode
    scene: int
    episode: Episode | None
    """None if the server failed."""
    grade: Grade | None
    key: str | float | tuple[str | float, ...]
    is_choice: bool
    """Whether the key is compared exactly, for example as the number of an object or option."""
    failure: str = ""


def scene_of(log: LoggedEpisode, names: Mapping[int, str]) -> int | None:
    """Find the scene of a log by the title in its prompt, otherwise by its number; None if there is no such pack.

    The title takes precedence, because some published folders have the number of another scene.
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
    """Replay logs. Logs without a pack or without a reply are left out.

    Args:
        logs: The logs.
        laboratory: Laboratory that serves the authors' packs.
        keys: The answer keys of the same packs.
        names: Scene → title, of the same packs.
        versions: Scene → versions to record.
        jobs: Largest number of logs replayed concurrently.
        on_end: Called with each log after its replay.
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
    """Return the logs that can be replayed, each with a unique key; epochs distinguish repeated scenes."""
    keyed: list[tuple[LoggedEpisode, EpisodeKey]] = []
    epochs = Counter[EpisodeKey]()
    for log in logs:
        scene = scene_of(log, names)
        if scene is None or not log.replies:
            continue
        # A log may contain one reply more than its budget, which the authors' program ignored.
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
