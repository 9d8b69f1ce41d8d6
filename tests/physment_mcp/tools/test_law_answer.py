"""Tests of the argument `law` of `answer`: it exists where a scene asks for it; a refused law costs only the call."""

import json
from typing import Any

import pytest
from mcp import Client

from physment_mcp.errors import BadArgument, EpisodeOver
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import CallProtocol, PromptOptions, opening_prompt
from physment_mcp.serving.server import build_server, published_tools
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.calls import call, tools_of
from scenes import one_world

OPEN, SUITE, WORLD = 201, 29, one_world("world:5:1")
LAW: dict[str, Any] = {"acceleration": {"object_1": {"x": "object_1_push_x - 0.4*object_1_vx", "y": "0"}}}
BAD: dict[str, Any] = {"acceleration": {"object_1": {"x": "9**9**9"}}}


@pytest.mark.parametrize("scene", [OPEN, WORLD])
def test_only_the_answer_of_a_scene_that_asks_for_a_law_has_another_schema(scene: int) -> None:
    usual, asking = published_tools(), published_tools(tools_of(Session(load_scene(scene))))
    assert asking[:-1] == usual[:-1]
    before, after = (dict(tools[-1].input_schema["properties"]) for tools in (usual, asking))
    law = after.pop("law")
    assert before == after
    assert "law" not in asking[-1].input_schema["required"]
    assert "graded apart" in law["description"]
    assert "law" not in json.dumps([tool.input_schema for tool in usual])
    assert tools_of(Session(load_scene(SUITE))) is TOOLS


async def test_clients_are_told_the_tools_of_their_episode() -> None:
    for scene, asks in ((OPEN, True), (SUITE, False), (WORLD, True)):
        async with Client(build_server(EpisodeSlot(Session(load_scene(scene))))) as client:
            tools = (await client.list_tools()).tools
            assert ("law" in tools[-1].input_schema["properties"]) is asks
            resource = (await client.read_resource("physment://scene")).contents[0]
            assert ("law_answer" in resource.model_dump()["text"]) is asks


@pytest.mark.parametrize(("scene", "asks"), [(OPEN, True), (WORLD, True), (SUITE, False), (7, False)])
def test_prompts_mention_the_law_only_where_it_is_asked_for(scene: int, asks: bool) -> None:
    session = Session(load_scene(scene))
    for protocol in CallProtocol:
        prompt = opening_prompt(session, PromptOptions(protocol=protocol))
        assert ("`law`" in prompt) is asks
    listed = "law: {acceleration: object, let: object, state: object} or null = null"
    assert (listed in opening_prompt(session, PromptOptions(protocol=CallProtocol.TEXT))) is asks


def test_a_refused_law_does_not_consume_the_answer() -> None:
    session = Session(load_scene(OPEN))
    left = session.calls_left
    for law in (BAD, {"acceleration": {"gate": {"z": "1"}}}, [], 3, "x"):
        with pytest.raises(BadArgument, match="answer: law"):
            call(session, "answer", {"answer": [1, 2, 3], "law": law})
    assert (session.ended, session.state.law, session.calls_left) == (False, None, left)
    call(session, "answer", {"answer": [1, 2, 3], "law": LAW})
    assert (session.state.answer, session.state.law) == ([1, 2, 3], LAW)
    with pytest.raises(EpisodeOver):
        call(session, "answer", {"answer": [1, 2, 3], "law": LAW})


def test_a_law_that_is_no_object_is_refused_in_words_of_json() -> None:
    with pytest.raises(BadArgument, match=r"^answer: law must be a JSON object$"):
        call(Session(load_scene(OPEN)), "answer", {"answer": 1, "law": "ax = 0"})


def test_an_answer_without_a_law_or_with_none_is_accepted() -> None:
    for arguments in ({}, {"law": None}):
        session = Session(load_scene(OPEN))
        call(session, "answer", {"answer": [1, 2, 3], **arguments})
        assert (session.ended, session.state.law) == (True, None)


def test_a_scene_that_asks_for_no_law_refuses_one_as_before() -> None:
    with pytest.raises(BadArgument, match="there is no argument 'law'; the arguments are answer, steps"):
        call(Session(load_scene(SUITE)), "answer", {"answer": 1, "law": LAW})


@pytest.mark.parametrize("scene", [OPEN, 205])
def test_a_refusal_is_the_same_whatever_the_law_of_the_scene_is(scene: int) -> None:
    said: set[str] = set()
    for seed in range(6):
        for moved in (False, True):
            session = Session(load_scene(scene, seed))
            if moved:
                call(session, "step", {"duration": 0.5})
            with pytest.raises(BadArgument) as refused:
                call(session, "answer", {"answer": 1, "law": BAD})
            said.add(str(refused.value))
    assert len(said) == 1


def test_an_oversized_law_is_refused_before_it_is_read() -> None:
    with pytest.raises(BadArgument, match="20000 bytes"):
        call(Session(load_scene(OPEN)), "answer", {"answer": 1, "law": {"let": {"a": "1+" * 20_000}}})
