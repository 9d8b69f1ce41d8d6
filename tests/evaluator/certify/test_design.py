"""Tests of the agents that design experiments: their set of experiments, their choices, and the scenes that they
refuse.
"""

from dataclasses import replace

import anyio
import numpy as np
import pytest

from evaluator.agents.attackers.readings import read_opening
from evaluator.answers.engine import prompt_of, run
from evaluator.certify.design import Design, GreedyDesign, RandomDesign, experiments, greedy
from evaluator.certify.evidence import measured
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector
from evaluator.episode.loop import play_episode
from evaluator.errors import AgentError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Verdict, Versions
from evaluator.records.evidence import EvidenceVerdict, evidence_verdict
from evaluator.study.run_config import RunConfig, participants_of
from scenes import find_pack
from scenes.protocol import call

FALL = Subject.open(find_pack(7))


async def played(agent: GreedyDesign | RandomDesign, scene: int, seed: int) -> Episode:
    laboratory = MemoryConnector()
    key = EpisodeKey(scene=scene, seed=seed, agent=agent.name, budget=20)
    async with laboratory.open(scene, seed) as client:
        versions = Versions(physment="", protocol="", pack="")
        return await play_episode(agent, client, key, versions, laboratory.toolboxes)


@pytest.mark.parametrize("agent", [GreedyDesign(), RandomDesign()])
def test_both_agents_earn_the_answer_of_a_falling_ball(agent: GreedyDesign | RandomDesign) -> None:
    episode = anyio.run(played, agent, 7, 1)
    assert episode.outcome is Outcome.ANSWERED
    assert FALL.agrees(episode.answer, FALL.truth(FALL.draw(1)))
    found = measured(FALL, 1, episode, "")
    assert evidence_verdict(found, Verdict.CORRECT) is EvidenceVerdict.EARNED


def test_the_greedy_agent_prefers_an_experiment_that_tells_something() -> None:
    design = Design(FALL, greedy, 20)
    nothing = [call("get_position", object_id="object_1")]
    long, short = ([call("step", duration=time), *nothing] for time in (0.4, 0.01))
    assert greedy(design, [nothing, short, long]) == long


def test_the_fit_finds_the_drawn_values_from_readings() -> None:
    drawn = FALL.draw(5)
    design = Design(FALL, greedy, 20)
    session = FALL.session(drawn)
    for one in (call("step", duration=0.4), call("get_velocity", object_id="object_1")):
        design.made.append((one, anyio.run(run, session, one)))
    design.fit()
    assert design.suffices()
    assert design.answer() == pytest.approx(FALL.truth(drawn), rel=1e-3)


def test_experiments_are_few_and_leave_no_load_behind() -> None:
    opening = read_opening(prompt_of(FALL.files, FALL.draw(1).mjcf))
    options = experiments(opening, opening.objects)
    assert 2 < len(options) <= 40
    for batch in options:
        loads = [one for one in batch if one.tool.startswith("apply")]
        assert not loads or not np.any(next(reversed(loads[-1].arguments.values())))


def test_a_scene_without_hidden_values_or_with_too_many_is_refused_with_the_reason() -> None:
    bare = replace(FALL, pack=FALL.pack.model_copy(update={"knobs": {}}))
    with pytest.raises(AgentError, match="no design: the pack draws no hidden values"):
        Design(bare, greedy, 20)
    with pytest.raises(AgentError, match="more than 12 combinations"):
        Design(Subject.open(find_pack(99)), greedy, 20)


def test_the_command_line_finds_the_agents() -> None:
    config = RunConfig(agents=("evaluator.certify.design:GreedyDesign", "evaluator.certify.design:RandomDesign"))
    assert list(participants_of(config)) == ["greedy-design", "random-design"]
