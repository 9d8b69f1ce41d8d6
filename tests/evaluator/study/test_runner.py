"""Tests of the runner: limited concurrency, and each episode recorded once despite failures and stops."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path

import anyio
import pytest
from mcp import Client

from evaluator.agents.reference import ScriptedAgent
from evaluator.answers.grading import grade_missing
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.hosts import HostConnector
from evaluator.episode.loop import AgentParticipant
from evaluator.episode.player import Agent, Briefing, Feedback, Player, Reply
from evaluator.errors import AgentError, InfrastructureError, PermanentFailure, StoreError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Usage, Verdict
from evaluator.records.run import Plan
from evaluator.store.run_folder import RunFolder
from evaluator.study.meter import Limits, Meter
from evaluator.study.runner import MAX_ATTEMPTS, LocalPlay, Runner, missing
from physment_mcp import open_episode
from tests.builders.records import ANSWER, STEP, VERSIONS, answer

PACK = ("scene7.json", "scene7.xml", "solution.py")
SCRIPT = ScriptedAgent("x", {None: ((ANSWER,),)})


@dataclass
class InMemory:
    """A laboratory in this process. It counts openings, and the first openings of some seeds fail."""

    failures: dict[int, int] = field(default_factory=dict[int, int])
    opened: list[int] = field(default_factory=list[int])
    now: int = 0
    most: int = 0
    toolboxes: None = None

    @asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        self.opened.append(seed)
        if self.opened.count(seed) <= self.failures.get(seed, 0):
            raise InfrastructureError(f"failure {self.opened.count(seed)} of seed {seed}")
        self.now += 1
        self.most = max(self.most, self.now)
        try:
            async with Client(open_episode(scene).server()) as client:
                yield client
        except ExceptionGroup as group:
            # As in the real laboratories, where a connected client wraps errors.
            if group.subgroup(InfrastructureError):
                raise InfrastructureError("failed while connected") from group
            raise
        finally:
            self.now -= 1


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    made = RunFolder(tmp_path / "run")
    made.create(resume=False)
    return made


def keys(seeds: int) -> list[EpisodeKey]:
    return Plan(scenes=(7,), agents=("x",), budgets=(3,), seeds=tuple(range(seeds))).matrix()


def playing(laboratory: EpisodeConnector, *agents: Agent) -> LocalPlay:
    """Plays episodes of these agents."""
    participants = {agent.name: AgentParticipant(agent) for agent in agents}
    return LocalPlay(laboratory, participants, lambda _scene: VERSIONS)


async def run(laboratory: InMemory, folder: RunFolder, seeds: int, agent: Agent = SCRIPT, concurrency: int = 4) -> None:
    todo = missing(keys(seeds), folder.episodes())
    with anyio.fail_after(120):
        await Runner(play=playing(laboratory, agent), folder=folder, concurrency=concurrency).run(todo)


def lines(folder: RunFolder) -> int:
    return folder.episodes_file.read_bytes().count(b"\n")


@pytest.mark.parametrize("concurrency", [1, 3, 50])
async def test_no_more_episodes_are_open_than_the_concurrency_and_each_is_played_once(
    folder: RunFolder, concurrency: int
) -> None:
    laboratory = InMemory()
    await run(laboratory, folder, 10, concurrency=concurrency)
    assert laboratory.most <= concurrency
    assert sorted(laboratory.opened) == list(range(10))
    assert (lines(folder), set(folder.episodes())) == (10, set(keys(10)))


async def test_as_many_episodes_are_open_as_the_concurrency_allows(folder: RunFolder) -> None:
    class Waiting:
        """An agent that answers only when it plays three episodes at the same time."""

        name = "x"

        def __init__(self) -> None:
            self.playing = 0
            self.all_here = anyio.Event()

        def player(self, key: EpisodeKey, briefing: Briefing) -> "Waiting":
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            self.playing += 1
            if self.playing == 3:
                self.all_here.set()
            await self.all_here.wait()
            return Reply(calls=(ANSWER,))

    laboratory = InMemory()
    await run(laboratory, folder, 6, Waiting(), concurrency=3)
    assert laboratory.most == 3


@pytest.mark.parametrize(("failing", "replies"), [(0, 2), (1, 3), (2, 4), (3, 3)])
async def test_the_usage_of_failed_attempts_is_counted(folder: RunFolder, failing: int, replies: int) -> None:
    class Failing:
        """An agent that loses the laboratory after its first turn in some attempts, and otherwise answers in its
        second.
        """

        name = "x"
        attempts = 0

        def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
            self.attempts += 1
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            used = Usage(input_tokens=10, output_tokens=1, cost_usd=0.5)
            if feedback is None:
                return Reply(calls=(STEP,), usage=used)
            if self.attempts <= failing:
                raise InfrastructureError("the provider is gone")
            return Reply(calls=(ANSWER,), usage=used)

    meter = Meter(Limits(tokens=1_000_000))
    with anyio.fail_after(120):
        await Runner(play=playing(InMemory(), Failing()), folder=folder, meter=meter).run(keys(1))
    (episode,) = folder.episodes().values()
    expected = Outcome.INFRASTRUCTURE_ERROR if failing == MAX_ATTEMPTS else Outcome.ANSWERED
    assert episode.outcome is expected
    assert episode.usage == Usage(input_tokens=10 * replies, output_tokens=replies, cost_usd=0.5 * replies)
    assert (meter.tokens, meter.cost_usd) == (11 * replies, 0.5 * replies)


async def test_an_infrastructure_error_costs_an_attempt_and_not_the_episode(folder: RunFolder) -> None:
    laboratory = InMemory(failures={0: 1, 1: MAX_ATTEMPTS - 1})
    await run(laboratory, folder, 3)
    played = sorted(folder.episodes().values(), key=lambda episode: episode.key.seed)
    assert [(episode.outcome, episode.attempts) for episode in played] == [
        (Outcome.ANSWERED, 2),
        (Outcome.ANSWERED, MAX_ATTEMPTS),
        (Outcome.ANSWERED, 1),
    ]


async def test_an_agent_that_can_never_play_is_asked_once_and_the_others_play(folder: RunFolder, host_url: str) -> None:
    class Keyless:
        """An agent whose provider refuses the API key."""

        name = "keyless"
        asked = 0

        def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            self.asked += 1
            raise PermanentFailure("the provider refused the key")

    agent = Keyless()
    plan = Plan(scenes=(7,), agents=("keyless", "x"), budgets=(3,), seeds=(0, 1, 2))
    with anyio.fail_after(120):
        runner = Runner(play=playing(HostConnector(host_url), agent, SCRIPT), folder=folder)
        assert await runner.run(plan.matrix()) == "the provider refused the key"
    assert agent.asked == 1
    assert sorted((key.agent, key.seed) for key in folder.episodes()) == [("x", 0), ("x", 1), ("x", 2)]


async def test_after_a_failure_in_the_middle_an_episode_is_played_again_from_its_start(folder: RunFolder) -> None:
    class Shaky:
        """An agent that reads, and fails at its second turn on the first attempt."""

        name = "x"
        attempts = 0

        def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
            self.attempts += 1
            return _ShakyPlayer(fails=self.attempts == 1)

    @dataclass
    class _ShakyPlayer:
        fails: bool

        async def act(self, feedback: Feedback | None) -> Reply:
            if feedback is None:
                return Reply("one", calls=(STEP,))
            if self.fails:
                raise InfrastructureError("the provider is down")
            assert feedback.exchanges[0].content is not None
            time = feedback.exchanges[0].content["sim_time"]
            return Reply("two", calls=(answer(time),))

    laboratory = InMemory()
    await run(laboratory, folder, 1, Shaky())
    (episode,) = folder.episodes().values()
    assert [turn.reasoning for turn in episode.turns] == ["one", "two"]
    assert (episode.answer, episode.attempts) == (pytest.approx(0.1), 2)


async def test_an_episode_whose_attempts_all_failed_is_recorded_unscored_and_played_when_the_run_is_resumed(
    folder: RunFolder,
) -> None:
    laboratory = InMemory(failures={1: MAX_ATTEMPTS})
    await run(laboratory, folder, 3)
    failed = folder.episodes()[keys(3)[1]]
    assert (failed.outcome, failed.attempts, failed.error) == (
        Outcome.INFRASTRUCTURE_ERROR,
        MAX_ATTEMPTS,
        f"failure {MAX_ATTEMPTS} of seed 1",
    )
    assert grade_missing(failed.outcome).strict is Verdict.UNSCORED
    again = InMemory()
    await run(again, folder, 3)
    assert again.opened == [1]
    assert [episode.outcome for episode in folder.episodes().values()] == [Outcome.ANSWERED] * 3


async def test_an_agent_error_is_a_result_and_the_episode_is_not_played_again(folder: RunFolder) -> None:
    class Unwilling:
        name = "x"

        def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
            raise AgentError("I will not")

    laboratory = InMemory()
    await run(laboratory, folder, 2, Unwilling())
    await run(laboratory, folder, 2, Unwilling())
    assert sorted(laboratory.opened) == [0, 1]
    assert {episode.outcome for episode in folder.episodes().values()} == {Outcome.AGENT_ERROR}


async def test_a_run_continues_where_it_was_stopped_at_any_moment(folder: RunFolder) -> None:
    class Stop(Exception):
        pass

    @dataclass
    class Stopper:
        """An agent that plays the script, and is cancelled at its third episode."""

        name: str = "x"
        started: int = 0

        def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
            self.started += 1
            if self.started == 3:
                raise Stop
            return SCRIPT.player(key, briefing)

    rounds = 0
    while missing(keys(11), folder.episodes()):
        rounds += 1
        try:
            await run(InMemory(), folder, 11, Stopper(), concurrency=1)
        except* Stop:
            with folder.episodes_file.open("ab") as stream:
                stream.write(b'{"format":1,"key":{"sc' * rounds)
    assert rounds == 6
    assert lines(folder) == 11
    assert set(folder.episodes()) == set(keys(11))


async def test_an_episode_is_on_disk_when_its_end_is_reported(folder: RunFolder) -> None:
    reported: list[tuple[str, int]] = []

    def on_start(key: EpisodeKey) -> None:
        reported.append(("start", key.seed))

    def on_end(episode: Episode) -> None:
        assert folder.episodes()[episode.key] == episode
        reported.append(("end", episode.key.seed))

    runner = Runner(play=playing(InMemory(), SCRIPT), folder=folder, on_start=on_start, on_end=on_end)
    await runner.run(keys(2))
    assert reported == [("start", 0), ("end", 0), ("start", 1), ("end", 1)]


async def test_a_record_that_cannot_be_written_stops_the_run_and_keeps_what_was_written(folder: RunFolder) -> None:
    def on_end(episode: Episode) -> None:
        if episode.key.seed == 1:
            folder.episodes_file.rename(folder.path / "moved")
            folder.episodes_file.mkdir()

    with pytest.raises(ExceptionGroup) as stopped:
        await Runner(play=playing(InMemory(), SCRIPT), folder=folder, on_end=on_end).run(keys(5))
    assert stopped.value.subgroup(StoreError) is not None
    assert (folder.path / "moved").read_bytes().count(b"\n") == 2


async def test_a_run_with_nothing_to_play_ends_at_once(folder: RunFolder) -> None:
    await run(InMemory(), folder, 0)
    assert folder.episodes() == {}
