"""Tests that a script gives the same transcript over every transport."""

from typing import Any

import pytest
from mcp import Client
from pydantic_core import to_json

from evaluator.agents.reference import ReferenceAgent, ScriptedAgent
from evaluator.episode.connect import connect
from evaluator.episode.loop import play_episode
from evaluator.records.episode import Episode
from physment_mcp import open_episode
from tests.builders.records import VERSIONS, call, episode_key

TOUR = ScriptedAgent(
    "tour",
    {
        None: (
            (
                call("get_parameters", object_id=1),
                call("create_objects", name="probe", pos=[2, 0, 3], density=800, rgba=[1, 0, 0, 1]),
                call("apply_force", object_id="probe", force_vector=[1, 0.5, 0]),
                call("step", duration=0.333),
                call("get_acceleration", object_id="probe"),
                call("get_position", object_id="object_9"),
            ),
            (call("find_objects"), call("get_center_of_mass"), call("delete_objects", object_id="probe")),
            (call("step", duration=7), call("get_velocity", object_id="object_1"), call("answer", answer=[1, "a"])),
        )
    },
)


CASES = ((TOUR, 7), (TOUR, 71), (ReferenceAgent(), 96))


def canonical(episode: Episode) -> bytes:
    """Serialise an episode without its wall-clock times."""
    timed = {"started_at", "duration_s"}
    plain = episode.model_dump(exclude=timed)
    for turn in plain["turns"]:
        del turn["agent_s"], turn["server_s"]
        for exchange in turn["exchanges"]:
            del exchange["duration_s"]
    return to_json(plain)


async def through(server: str, agent: ScriptedAgent | ReferenceAgent, scene: int) -> bytes:
    key = episode_key(scene, seed=3, agent=agent.name)
    async with connect(server, None) as laboratory, laboratory.open(scene, 3) as client:
        return canonical(await play_episode(agent, client, key, VERSIONS))


async def in_memory(mode: Any, agent: ScriptedAgent | ReferenceAgent, scene: int) -> bytes:
    key = episode_key(scene, seed=3, agent=agent.name)
    async with Client(open_episode(scene, 3).server(), mode=mode) as client:
        return canonical(await play_episode(agent, client, key, VERSIONS))


@pytest.mark.parametrize(("agent", "scene"), CASES, ids=["created", "hidden", "reference"])
async def test_a_transcript_is_the_same_over_stdio_http_and_in_memory(
    agent: ScriptedAgent | ReferenceAgent, scene: int, host_url: str
) -> None:
    expected = await in_memory("auto", agent, scene)
    assert b'"returned":true' in expected
    assert await in_memory("legacy", agent, scene) == expected
    assert await through("stdio", agent, scene) == expected
    assert await through(host_url, agent, scene) == expected


async def test_a_transcript_over_a_socket_is_the_same_as_in_memory() -> None:
    async with connect("host", None) as laboratory:
        for agent, scene in CASES:
            key = episode_key(scene, seed=3, agent=agent.name)
            async with laboratory.open(scene, 3) as client:
                played = await play_episode(agent, client, key, VERSIONS, laboratory.toolboxes)
            assert canonical(played) == await in_memory("auto", agent, scene)
