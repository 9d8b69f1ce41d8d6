"""Tests that the reference agent solves a scene of each category, and that guessers are right at chance level."""

import json
import math
from pathlib import Path

import pytest
from mcp import Client

from evaluator.agents.baselines import GUESS_RANGE, BlindAgent, OracleOnceAgent, RandomAgent
from evaluator.agents.reference import ReferenceAgent, load_script
from evaluator.answers.grading import grade
from evaluator.answers.keys import KeyRing
from evaluator.answers.strict import AnswerKey
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Verdict
from physment_mcp import open_episode
from scenes import list_packs
from tests.builders.records import ANSWER, STEP, VERSIONS, episode_key

SCENES = [files.scene_id for files in list_packs()]
KEYS = KeyRing()


async def play(agent: ReferenceAgent | RandomAgent | BlindAgent | OracleOnceAgent, scene: int, seed: int) -> Episode:
    async with Client(open_episode(scene, seed).server()) as client:
        return await play_episode(agent, client, episode_key(scene, seed=seed), VERSIONS)


@pytest.mark.parametrize(
    "scene",
    [
        *(7, 16, 21, 41, 46, 51, 66, 71, 96),
        *(pytest.param(scene, marks=pytest.mark.extended) for scene in (26, 76, 91, 101)),
    ],
)
async def test_the_reference_protocol_gives_the_right_answer_through_mcp(scene: int) -> None:
    """Plays seed 2, because the test that plays all scenes uses other seeds."""
    seed = 2
    episode = await play(ReferenceAgent(), scene, seed)
    assert episode.outcome is Outcome.ANSWERED
    verdict = grade(episode.answer, KEYS.key(scene, seed))
    assert verdict.strict is Verdict.CORRECT, verdict.reason


def chance(key: AnswerKey) -> float:
    """Return the probability that a guess is right, from the key and the distribution of guesses."""
    if key.spec.options:
        return 1 / len(key.spec.options)
    values = key.value if isinstance(key.value, tuple) else (key.value,)
    low, high = GUESS_RANGE
    probability = 1.0
    for value in values:
        size = float(value)
        slack = key.spec.abs_tol + key.spec.rel_tol * abs(size)
        bottom, top = max(size - slack, low), min(size + slack, high)
        probability *= max(0.0, math.log(top / bottom)) / math.log(high / low) if top > bottom else 0.0
    return probability


def central_interval(chances: list[float], level: float) -> tuple[int, int]:
    """Return the smallest central range of successes with at least this probability (Poisson-binomial)."""
    distribution = [1.0]
    for p in chances:
        distribution = [
            (distribution[k] if k < len(distribution) else 0.0) * (1 - p) + (distribution[k - 1] * p if k else 0.0)
            for k in range(len(distribution) + 1)
        ]
    tail, total, low = (1 - level) / 2, 0.0, 0
    cumulated = []
    for share in distribution:
        total += share
        cumulated.append(total)
    low = next(k for k, share in enumerate(cumulated) if share > tail)
    high = next(k for k, share in enumerate(cumulated) if share >= 1 - tail)
    return low, high


@pytest.mark.extended
@pytest.mark.parametrize("agent", [BlindAgent(), RandomAgent()], ids=lambda agent: agent.name)
async def test_a_guesser_is_right_as_often_as_chance_predicts_over_200_episodes(
    agent: BlindAgent | RandomAgent,
) -> None:
    cells = [(scene, seed) for seed in range(1, math.ceil(200 / len(SCENES)) + 1) for scene in SCENES]
    assert len(cells) >= 200
    right = 0
    for scene, seed in cells:
        episode = await play(agent, scene, seed)
        assert episode.outcome is Outcome.ANSWERED
        right += grade(episode.answer, KEYS.key(scene, seed)).strict is Verdict.CORRECT
    low, high = central_interval([chance(KEYS.key(*cell)) for cell in cells], 0.999)
    assert low <= right <= high, f"{right} right of {len(cells)}, chance gives {low} to {high}"


@pytest.mark.parametrize("agent", [BlindAgent(), RandomAgent()], ids=lambda agent: agent.name)
async def test_a_guesser_repeats_an_episode_exactly_and_plays_another_episode_differently(
    agent: BlindAgent | RandomAgent,
) -> None:
    first, second, other = [await play(agent, 7, seed) for seed in (3, 3, 4)]
    assert _untimed(first) == _untimed(second)
    assert first.answer != other.answer


def _untimed(episode: Episode) -> list[object]:
    """Return calls and results without times."""
    return [(exchange.call, exchange.text) for turn in episode.turns for exchange in turn.exchanges]


async def test_oracle_once_sees_the_returns_of_one_batch_and_can_then_only_answer() -> None:
    class Eager:
        name = "eager"
        turns = 0

        def player(self, key: EpisodeKey, briefing: Briefing) -> "Eager":
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            self.turns += 1
            if self.turns == 1:
                return Reply(calls=(STEP, STEP))
            assert feedback is not None
            assert (len(feedback.exchanges), feedback.remaining) == (2, 1)
            return Reply(calls=(STEP, ANSWER))

    episode = await play(OracleOnceAgent(Eager()), 7, 0)
    assert [len(turn.exchanges) for turn in episode.turns] == [2, 1]
    assert episode.answer == 1


async def test_oracle_once_solves_a_scene_that_needs_one_batch_and_not_one_that_needs_several() -> None:
    easy, hard = [await play(OracleOnceAgent(ReferenceAgent()), scene, 0) for scene in (7, 26)]
    assert easy.outcome is Outcome.ANSWERED
    assert hard.outcome is Outcome.BUDGET_EXHAUSTED


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("[[", "cannot be read: Expecting"),
        ('{"seven": []}', "malformed at seven"),
        ('[{"tool": "step"}]', "malformed"),
        ('[[{"tool": "step", "arguments": {}, "when": 1}]]', "when"),
    ],
)
def test_a_malformed_script_is_refused_with_the_place_of_the_error(tmp_path: Path, content: str, problem: str) -> None:
    file = tmp_path / "script.json"
    file.write_text(content, encoding="utf-8")
    with pytest.raises(UsageError, match=problem):
        load_script(file)


def test_a_missing_script_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"none\.json cannot be read: No such file or directory$"):
        load_script(tmp_path / "none.json")


async def test_a_script_may_have_other_turns_for_each_scene(tmp_path: Path) -> None:
    file = tmp_path / "script.json"
    turns = [[{"tool": "answer", "arguments": {"answer": 5}}]]
    file.write_text(json.dumps({"7": turns}), encoding="utf-8")
    agent = load_script(file)
    async with Client(open_episode(7).server()) as client:
        assert (await play_episode(agent, client, episode_key(7, seed=0), VERSIONS)).answer == 5
    async with Client(open_episode(21).server()) as client:
        assert (await play_episode(agent, client, episode_key(21, seed=0), VERSIONS)).outcome is Outcome.AGENT_ERROR
