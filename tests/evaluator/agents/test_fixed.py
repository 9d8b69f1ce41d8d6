"""Tests of the baselines that know the pack of a scene but not its hidden values at the seed."""

import pytest

from evaluator.agents.reference import BatchAgent, ConstantAgent, best_constant
from evaluator.episode.player import Briefing
from evaluator.errors import AgentError
from evaluator.study.run_config import RunConfig, participants_of
from scenes.answer_spec import AnswerKind, AnswerSpec
from tests.builders.records import episode_key

BRIEFING = Briefing(prompt="", tools=(), budget=20, scene={})
NUMBER = AnswerSpec(kind=AnswerKind.NUMBER)


def test_the_best_constant_is_right_for_most_keys() -> None:
    assert best_constant(["left", "right", "left"], AnswerSpec(kind=AnswerKind.CHOICE)) == ("left", 2 / 3)
    assert best_constant([1.0, 4.0, 4.1, 9.0], NUMBER) == (4.0, 0.5)
    # Neither key is within 5 % of the other; their mean is within 5 % of both.
    constant, share = best_constant([1.0, 1.06], NUMBER)
    assert (constant, share) == (pytest.approx(1.03), 1.0)
    numbers = AnswerSpec(kind=AnswerKind.NUMBERS, labels=("a", "b"))
    assert best_constant([[1.0, 2.0], [1.0, 7.0], [1.0, 2.05]], numbers) == ([1.0, 2.0], 2 / 3)


async def test_the_constant_agent_gives_one_answer_at_every_seed_of_a_scene() -> None:
    agent = ConstantAgent()
    replies = [await agent.player(episode_key(7, seed=seed), BRIEFING).act(None) for seed in (0, 5)]
    assert replies[0] == replies[1]
    assert [call.tool for call in replies[0].calls] == ["answer"]


async def test_the_batch_agent_plays_the_batch_of_the_scene_and_refuses_scenes_without_one() -> None:
    with pytest.raises(AgentError, match=r"solution\.py of scene 7 defines none"):
        BatchAgent().player(episode_key(7), BRIEFING)
    assert BatchAgent().player(episode_key(26), BRIEFING) is not None


def test_both_can_be_named_in_a_run() -> None:
    assert list(participants_of(RunConfig(agents=("constant", "batch")))) == ["constant", "batch"]
