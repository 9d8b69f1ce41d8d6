"""Forks: the first turns of a stored episode are replayed, and another agent continues from there.

Two agents that continue from the same turn have the same evidence, so a difference in their answers comes from their
reasoning. The record of a fork holds only calls and results for the replayed turns. The reasoning of the first agent
stays in the record of the stored episode.
"""

import functools
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, replace

from pydantic import JsonValue

from evaluator.agents.recorded import RepeatingPlayer, exact_difference, replies_of
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.loop import AgentParticipant, play_episode
from evaluator.episode.player import Agent, Briefing, Feedback, Reply
from evaluator.episode.protocols.text import feedback_text
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Exchange, Fork, Outcome, Usage, Versions
from evaluator.store.run_folder import RunFolder
from scenes import reference_of

CONDITIONS = ("scene", "seed", "agent", "budget", "prompting", "protocol", "epoch")
"""Names of the conditions that `--episode` accepts: fields of an episode's key."""
_SCENE = re.compile(r"\d+|world:\d+:\d+")
_CONDITION = re.compile(rf"(?:^|,)\s*({'|'.join(CONDITIONS)})=")


@dataclass(frozen=True, slots=True)
class ForkedAgent:
    """An agent that repeats the calls of a stored episode up to a turn and then hands over to another agent."""

    inner: Agent
    stored: Mapping[EpisodeKey, Episode]
    """Key of the new episode → the stored one."""
    turn: int

    @property
    def name(self) -> str:
        """Name of the agent that continues the episode."""
        return self.inner.name

    def player(self, key: EpisodeKey, briefing: Briefing) -> RepeatingPlayer:
        """The player of one episode.

        Raises:
            UsageError: The opening prompt is not the one that the stored episode began with.
        """
        stored = self.stored[key]
        if briefing.prompt != stored.prompt:
            raise UsageError(
                f"{described(stored.key)} cannot be continued: the laboratory's opening prompt has changed"
            )
        replies = [Reply(calls=reply.calls) for reply in replies_of(stored.turns[: self.turn])]
        return RepeatingPlayer(
            replies,
            compare=functools.partial(_refuse_other_returns, stored),
            go_on=lambda: self.inner.player(key, self._after(stored, briefing)),
        )

    def _after(self, stored: Episode, briefing: Briefing) -> Briefing:
        prompt = f"{briefing.prompt}\n\n{account(stored, self.turn)}"
        return replace(briefing, prompt=prompt, budget=briefing.budget - self.turn)


def _refuse_other_returns(stored: Episode, turn: int, returned: Sequence[Exchange]) -> None:
    recorded = stored.turns[turn - 1].exchanges
    if len(returned) != len(recorded):
        raise UsageError(
            f"{described(stored.key)} cannot be continued: turn {turn} has {len(recorded)} recorded calls, of which the"
            f" laboratory now runs {len(returned)}"
        )
    for number, (old, new) in enumerate(zip(recorded, returned, strict=True), start=1):
        found = exact_difference(old, new)
        if found is None and old.frames != new.frames:
            found = "frames", [one.name for one in old.frames], [one.name for one in new.frames]
        if found is not None:
            path, was, now = found
            raise UsageError(
                f"{described(stored.key)} cannot be continued: at turn {turn}, call {number}"
                f" ({old.call.tool}{path and f': {path}'}) {was} is recorded, and the laboratory now returns {now}"
            )


def account(stored: Episode, turn: int) -> str:
    """Return a text with the replayed turns, which the next agent gets after the opening prompt."""
    budget = stored.key.budget
    turns = [
        f"## Iteration {number}\n\n"
        + feedback_text(Feedback(played.exchanges, played.note if played.exchanges else "", budget - number))
        for number, played in enumerate(stored.turns[:turn], start=1)
    ]
    opening = (
        f"# What has been done\n\nThe experiment is under way: {turn} of the {budget} iterations are used up, and"
        f" {budget - turn} are left. These calls were made, with these returns. Go on from here."
    )
    return "\n\n".join([opening, *turns])


@dataclass(frozen=True, slots=True)
class ForkParticipant:
    """An agent that continues a copy of a stored episode, after the calls before the chosen turn were replayed."""

    inner: AgentParticipant
    stored: Mapping[EpisodeKey, Episode]
    hashes: Mapping[EpisodeKey, str]
    """Key of the stored episode → SHA-256 of its line."""
    turn: int

    @property
    def name(self) -> str:
        """The agent's name."""
        return self.inner.name

    def facts(self) -> Mapping[str, JsonValue]:
        """The settings of the agent that continues the episode, as recorded in `run.json`."""
        return self.inner.facts()

    def running(self) -> AbstractAsyncContextManager[object]:
        """The context in which the agent that continues the episode can play, for example with open connections."""
        return self.inner.running()

    async def play(
        self, laboratory: EpisodeConnector, key: EpisodeKey, versions: Versions, used: list[Usage]
    ) -> Episode:
        """Play one episode whose first turns repeat the stored calls.

        Raises:
            UsageError: The laboratory's result of a repeated call differs from the stored one.
        """
        agent = ForkedAgent(self.inner.agent, self.stored, self.turn)
        origin = self.stored[key].key
        async with laboratory.open(key.scene, key.seed) as client:
            episode = await play_episode(agent, client, key, versions, laboratory.toolboxes, used)
        fork = Fork(key=origin, turn=self.turn, record_sha256=self.hashes[origin])
        return episode.model_copy(update={"forked_from": fork})


def select_episodes(folder: RunFolder, text: str, turn: int) -> list[Episode]:
    """The stored episodes that can be continued after a turn.

    Args:
        folder: The run.
        text: A scene or conditions such as `scene=7,seed=3`, as `--episode` takes them.
        turn: Number of turns to replay.

    Raises:
        UsageError: A condition is malformed, no episode meets them, or all that do are too short.
        StoreError: A record is damaged.
    """
    played = [episode for episode in folder.episodes().values() if episode.outcome is not Outcome.INFRASTRUCTURE_ERROR]
    found = meeting(played, text, "--episode", folder)
    programs = [episode for episode in found if episode.max_calls is not None]
    if programs:
        raise UsageError(
            f"{described(programs[0].key)} was played by a program, which has calls and no turns to go on from"
        )
    # The answer ends an episode, so a fork must be before the answering turn.
    long = [episode for episode in found if turn < _last(episode)]
    if not long:
        most = max(_last(episode) for episode in found) - 1
        raise UsageError(
            f"--turn {turn}: none of these {len(found)} episodes goes on after it; it can be {most} at most"
        )
    agents = sorted({episode.key.agent for episode in long})
    if len(agents) > 1:
        raise UsageError(f"--episode {text}: these are episodes of {', '.join(agents)}; add agent=… to choose one")
    return long


def meeting(episodes: Sequence[Episode], text: str, option: str, folder: RunFolder) -> list[Episode]:
    """Select the episodes whose keys meet all conditions.

    Args:
        episodes: Episodes to choose from.
        text: A scene such as `7`, or conditions such as `scene=7,seed=3`.
        option: Name of the command line option that holds `text`, for error messages.
        folder: Run folder of the episodes, for error messages.

    Raises:
        UsageError: A condition is malformed, or no episode meets them.
    """
    wanted = _conditions(text, option)
    found = [one for one in episodes if all(value in _values(one.key, name) for name, value in wanted.items())]
    if not found:
        some = f", such as {described(episodes[0].key)}" if episodes else ""
        raise UsageError(
            f"{option} {text}: {folder.path} holds {len(episodes)} episodes{some}, and none of them is meant"
        )
    return found


def _values(key: EpisodeKey, name: str) -> set[str]:
    """Return the texts that match a field of an episode's key in a condition such as `scene=7`.

    A scene has two: its id, and its reference such as `world:5:3`.
    """
    value = str(getattr(key, name))
    return {value, reference_of(key.scene)} if name == "scene" else {value}


def _last(episode: Episode) -> int:
    """Return the first turn from which no fork is possible: the answering turn, or the last of the budget."""
    return (
        len(episode.turns) if episode.outcome is Outcome.ANSWERED else min(len(episode.turns) + 1, episode.key.budget)
    )


def _conditions(text: str, option: str) -> dict[str, str]:
    if _SCENE.fullmatch(text):
        return {"scene": text}
    found = list(_CONDITION.finditer(text))
    ends = [*(match.start() for match in found[1:]), len(text)][: len(found)]
    wanted = {match[1]: text[match.end() : end].strip() for match, end in zip(found, ends, strict=True)}
    if not found or found[0].start() != 0 or not all(wanted.values()):
        raise UsageError(
            f"{option} {text}: write the number of a scene, or write conditions such as scene=7,seed=3; they are"
            f" {', '.join(CONDITIONS)}"
        )
    return wanted


def fork_keys(episodes: Sequence[Episode], agents: Sequence[str]) -> dict[EpisodeKey, Episode]:
    """Map the key of each new episode to the stored episode that it continues."""
    return {episode.key.model_copy(update={"agent": agent}): episode for agent in agents for episode in episodes}


def described(key: EpisodeKey) -> str:
    """Describe an episode by its key, for error messages."""
    return f"scene {reference_of(key.scene)}, seed {key.seed}, {key.agent}, budget {key.budget}, epoch {key.epoch}"
