"""Tests of typed commands, parsed with the published tools."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.episode.player import ToolDescription
from evaluator.episode.protocols.typed import TypingError, parse_line, signature
from evaluator.records.episode import ToolCall
from physment_mcp.scene import load_scene
from physment_mcp.serving.server import published_tools
from physment_mcp.session import Session
from physment_mcp.tools.calls import tools_of
from tests.builders.records import call

TOOLS = tuple(ToolDescription(tool.name, tool.description or "", tool.input_schema) for tool in published_tools())


@pytest.mark.parametrize(
    ("line", "calls"),
    [
        ("", []),
        (" ;; ", []),
        ("step 0.5", [call("step", duration=0.5)]),
        ("step .5", [call("step", duration=0.5)]),
        ("step duration=+1e-3", [call("step", duration=0.001)]),
        ("  find_objects  ", [call("find_objects")]),
        ("get_position object_1", [call("get_position", object_id="object_1")]),
        ("get_position 1", [call("get_position", object_id=1)]),
        (
            "apply_force object_1 [1,0,0]",
            [call("apply_force", object_id="object_1", force_vector=[1, 0, 0])],
        ),
        (
            "apply_force object_1 [ 1, -0.5 , 2e1 ]",
            [call("apply_force", object_id="object_1", force_vector=[1, -0.5, 20.0])],
        ),
        ("apply_force 1 1,0,0", [call("apply_force", object_id=1, force_vector=[1, 0, 0])]),
        ("apply_force 1 [1 0 0]", [call("apply_force", object_id=1, force_vector=[1, 0, 0])]),
        (
            "apply_force force_vector=[1,0,0] object_id=object_1",
            [call("apply_force", object_id="object_1", force_vector=[1, 0, 0])],
        ),
        (
            "step 1; get_velocity 1;answer 1.2",
            [call("step", duration=1), call("get_velocity", object_id=1), call("answer", answer=1.2)],
        ),
        (
            "detect_collision 1 2 no",
            [call("detect_collision", obj1_id=1, obj2_id=2, elastic_response=False)],
        ),
        (
            "attach_objects 1 2 hinge [0,0,1]",
            [call("attach_objects", object1_id=1, object2_id=2, joint="hinge", axis=[0, 0, 1])],
        ),
        ("attach_objects 1 2 axis=null", [call("attach_objects", object1_id=1, object2_id=2, axis=None)]),
        (
            'create_objects "my probe" [0,0,1] 1000 [1,0,0,1]',
            [call("create_objects", name="my probe", pos=[0, 0, 1], density=1000, rgba=[1, 0, 0, 1])],
        ),
        ("answer object 2 is heavier", [call("answer", answer="object 2 is heavier")]),
        ("answer it's 1,200 N", [call("answer", answer="it's 1,200 N")]),
        ('answer "first; second"', [call("answer", answer="first; second")]),
        ('answer "1.5"', [call("answer", answer="1.5")]),
        ('answer "a \\"b\\"; c"', [call("answer", answer='a "b"; c')]),
        ("answer [1, 2.5]", [call("answer", answer=[1, 2.5])]),
        ("answer [1, rising]", [call("answer", answer=[1, "rising"])]),
        ("answer answer=3", [call("answer", answer=3)]),
        ("answer x=3", [call("answer", answer="x=3")]),
        ("answer nan", [call("answer", answer="nan")]),
        ('answer 3 steps={"mass": 2.5}', [call("answer", answer=3, steps={"mass": 2.5})]),
        (
            'answer "it tips" steps={"angle": "0.3", "n": 2}',
            [call("answer", answer="it tips", steps={"angle": "0.3", "n": 2})],
        ),
        ("answer 3 steps=null", [call("answer", answer=3, steps=None)]),
    ],
)  # fmt: skip
def test_a_typed_line_is_parsed_into_calls(line: str, calls: list[ToolCall]) -> None:
    assert list(parse_line(line, TOOLS)) == calls


def test_a_law_is_typed_where_the_scene_asks_for_one() -> None:
    tools = published_tools(tools_of(Session(load_scene(201))))
    asking = tuple(ToolDescription(tool.name, tool.description or "", tool.input_schema) for tool in tools)
    law = {"acceleration": {"object_1": {"x": "1 + 2"}}}
    (typed,) = parse_line('answer [1, 2, 3] law={"acceleration": {"object_1": {"x": "1 + 2"}}}', asking)
    assert typed == call("answer", answer=[1, 2, 3], law=law)
    (plain,) = parse_line('answer 3 law={"acceleration": {}}', TOOLS)
    assert plain == call("answer", answer='3 law={"acceleration": {}}')


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("stp 1", "there is no tool 'stp'; do you mean step?"),
        ("qwertz", "there is no tool 'qwertz'"),
        ("step", "duration is missing; the form is: step duration"),
        ("step fast", "duration: fast is not a number"),
        ("step nan", "duration: nan is not a number"),
        ("step 1e999", "duration: 1e999 is not a number"),
        ("step 0", "step: duration: "),
        ("step 100", "step: duration: "),
        ("step 1 2", "duration: 1 2 is not a number"),
        ("find_objects now", "'now' is too much; the form is: find_objects"),
        ("apply_force 1", "force_vector is missing"),
        ("apply_force 1 [1,0]", "apply_force: force_vector: "),
        ("apply_force 1 [1,0,up]", "force_vector: up is not a number"),
        ("apply_force 1 [1,,0]", "force_vector: nothing is not a number"),
        ("apply_force 1 [1,0,0", "a quote or bracket is not closed"),
        ("apply_force 1 1,0,0]", "] closes nothing"),
        ("apply_force 1 [1,0,0] 4", "'4' is too much"),
        ("apply_force 1 object_id=2 [1,0,0]", "object_id is given twice"),
        ("detect_collision 1 2 maybe", "elastic_response: maybe is not true or false"),
        ("attach_objects 1 2 glue", "attach_objects: joint: "),
        ('answer "open', "a quote or bracket is not closed"),
        ('answer "a" b', 'answer: "a" b is not a text in quotes'),
        ("step 1; stp 1", "there is no tool 'stp'"),
        ("answer 3 steps={mass}", 'steps: {mass} is not an object such as {"mass": 2.5}'),
        ("answer 3 4 steps=null", "steps: 4 is not an object such as"),
        ("answer 3 steps={}x", "steps: {}x is not an object"),
    ],
)
def test_a_typing_error_is_answered_with_one_helpful_sentence(line: str, said: str) -> None:
    with pytest.raises(TypingError) as refused:
        parse_line(line, TOOLS)
    assert said in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_every_tool_has_a_signature() -> None:
    shown = [signature(tool) for tool in TOOLS]
    assert "get_potential_energy object_id mass [gravity=9.81]" in shown
    assert "find_objects" in shown
    assert len(set(shown)) == 26


NUMBERS = st.one_of(st.integers(-1000, 1000), st.floats(-1000, 1000))


@given(st.lists(NUMBERS, min_size=3, max_size=3), st.text(max_size=30))
def test_any_json_string_and_vector_can_be_typed(vector: list[float], text: str) -> None:
    line = f"apply_force {json.dumps(text or 'a')} {json.dumps(vector)}; answer {json.dumps(text)}"
    try:
        force, answer = parse_line(line, TOOLS)
    except TypingError as error:
        assert "object_id" in str(error)  # noqa: PT017 - only an id that is too long is refused
        return
    assert force.arguments == {"object_id": text or "a", "force_vector": vector}
    assert answer.arguments == {"answer": text}


@given(st.text(max_size=60))
def test_any_line_gives_calls_or_an_error_sentence(line: str) -> None:
    try:
        calls = parse_line(line, TOOLS)
    except TypingError as error:
        assert str(error)  # noqa: PT017 - either outcome is right
    else:
        assert all(isinstance(parsed, ToolCall) for parsed in calls)
