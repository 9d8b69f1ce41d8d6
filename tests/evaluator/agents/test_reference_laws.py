"""Tests that the reference states with its answer a law that is equivalent to that of the laboratory."""

import pytest

from evaluator.agents.reference import ReferenceAgent
from evaluator.answers.keys import KeyRing
from evaluator.answers.laws import stated_law
from evaluator.certify.verify import MemoryConnector
from evaluator.episode.loop import play_episode
from evaluator.records.episode import EpisodeKey
from evaluator.scores.scoring import law_grade
from scenes import one_world, reference_of
from tests.builders.records import VERSIONS

SCENES = (pytest.param(201, marks=pytest.mark.extended), one_world("world:1:1"))


@pytest.mark.parametrize("scene", SCENES, ids=reference_of)
async def test_the_reference_states_an_equivalent_law(scene: int) -> None:
    agent, memory = ReferenceAgent(), MemoryConnector()
    key = EpisodeKey(scene=scene, seed=2, agent=agent.name, budget=20)
    async with memory.open(scene, 2) as client:
        episode = await play_episode(agent, client, key, VERSIONS, memory.toolboxes)
    assert stated_law(episode) is not None
    found = law_grade(episode, KeyRing())
    assert found is not None
    assert (found.equivalent, found.dependence_f1) == (True, 1)


async def test_the_reference_states_no_law_where_none_is_asked_for() -> None:
    agent, memory = ReferenceAgent(), MemoryConnector()
    key = EpisodeKey(scene=7, seed=2, agent=agent.name, budget=20)
    async with memory.open(7, 2) as client:
        assert stated_law(await play_episode(agent, client, key, VERSIONS, memory.toolboxes)) is None
