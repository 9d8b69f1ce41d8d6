"""Tests of the text protocol: the calls and the prose of a reply, and the text that the agent gets back."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluator.episode.player import Feedback
from evaluator.episode.protocols.text import feedback_text, parse_reply
from evaluator.records.episode import ToolCall
from tests.builders.records import LOOK, answer, call, refused, rejected, returned, skipped

STEP = call("step", duration=0.5)
ANSWER = answer("2")
STEP_TEXT = '{"tool": "step", "parameters": {"duration": 0.5}}'
LOOK_TEXT = '{"tool": "get_position", "parameters": {"object_id": "object_1"}}'
ANSWER_TEXT = '{"tool": "answer", "parameters": {"answer": "2"}}'

NAMES = st.text("abcxyz_", min_size=1, max_size=12)
JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**9), 10**9)
    | st.floats(allow_nan=False, allow_infinity=False)
    # A reply is valid Unicode text, without lone surrogates.
    | st.text(st.characters(codec="utf-8"), max_size=12),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3),
    max_leaves=6,
)
CALLS = st.lists(
    st.builds(ToolCall, tool=NAMES, arguments=st.dictionaries(NAMES, JSON, max_size=3)), min_size=1, max_size=3
)
PROSE = st.text(st.characters(codec="utf-8", exclude_characters="{}[]`<>"), max_size=200)


def written(calls: list[ToolCall], indent: int | None = None) -> str:
    listed = [{"tool": call.tool, "parameters": call.arguments} for call in calls]
    return json.dumps(listed, ensure_ascii=False, indent=indent)


@given(calls=CALLS, before=PROSE, after=PROSE, fenced=st.booleans(), indent=st.sampled_from([None, 2]))
def test_calls_in_prose_are_found(
    calls: list[ToolCall], before: str, after: str, fenced: bool, indent: int | None
) -> None:
    listed = written(calls, indent)
    reply = parse_reply(f"{before}\n```json\n{listed}\n```\n{after}" if fenced else f"{before}\n{listed}\n{after}")
    assert (reply.malformed, list(reply.calls)) == ("", calls)
    assert reply.reasoning == "\n\n".join(part for part in (before.strip(), after.strip()) if part)


@given(st.text() | st.text(alphabet="[]{}\":,'\\ \n`/*1e-.tol<|>", max_size=400))
@settings(max_examples=300)
def test_the_parser_never_raises(text: str) -> None:
    reply = parse_reply(text)
    assert not (reply.malformed and reply.calls)
    assert reply.calls or reply.reasoning == text


@given(CALLS, st.data())
def test_a_truncated_list_runs_nothing(calls: list[ToolCall], data: st.DataObject) -> None:
    text = written(calls)
    cut = data.draw(st.integers(0, len(text) - 1))
    assert parse_reply(text[:cut]).calls == ()


@given(CALLS, st.data())
def test_a_list_with_a_missing_or_extra_bracket_never_runs_only_a_part(
    calls: list[ToolCall], data: st.DataObject
) -> None:
    text = written([call(f"{listed.tool}{number}", x=[number]) for number, listed in enumerate(calls)])
    at = data.draw(st.sampled_from([index for index, sign in enumerate(text) if sign in "[]{}"]))
    changed = text[:at] + text[at + 1 :] if data.draw(st.booleans()) else text[:at] + text[at] + text[at:]
    run = parse_reply(f"I look.\n{changed}\nAnd see.").calls
    # Only the outer brackets of the list may be missing or doubled.
    assert run == () or len(run) == len(calls)


@pytest.mark.parametrize(
    "text",
    [
        f"I look.\n\n[{STEP_TEXT}, {LOOK_TEXT}]",
        f"```json\n[{STEP_TEXT}, {LOOK_TEXT}]\n```",
        f"```\n[{STEP_TEXT},\n {LOOK_TEXT}]",
        f"```json [{STEP_TEXT}, {LOOK_TEXT},] ```",
        f"{STEP_TEXT}\n{LOOK_TEXT}",
        f"{STEP_TEXT}, {LOOK_TEXT}",
        f"[{STEP_TEXT} {LOOK_TEXT}]",
        f"<tool_call>\n[{STEP_TEXT}, {LOOK_TEXT}]\n</tool_call>",
        f'{{"thoughts": ["a", "b"], "tool_calls": [{STEP_TEXT}, {LOOK_TEXT}]}}',
        f"[{STEP_TEXT}, // half a second\n {LOOK_TEXT} /* and look */]",
        "[{'tool': 'step', 'parameters': {'duration': .5}}, "
        "{'name': 'get_position', 'arguments': {'object_id': 'object_1'}}]",
        '[{"function": "step", "args": {"duration": 0.5}}, '
        '{"tool": "get_position", "input": {"object_id": "object_1"}}]',
        '[{"type": "function", "function": {"name": "step", "arguments": "{\\"duration\\": 0.5}"}}, '
        '{"type": "function", "function": {"name": "get_position", "arguments": {"object_id": "object_1"}}}]',
        "<|tool_calls_section_begin|> <|tool_call_begin|> functions.step:0 <|tool_call_argument_begin|> "
        '{"duration": 0.5} <|tool_call_end|> <|tool_call_begin|> functions.get_position:1 '
        '<|tool_call_argument_begin|> {"object_id": "object_1"} <|tool_call_end|> <|tool_calls_section_end|>',
        f"At [0, 0, 1] it has v = {{2}}.\n[{STEP_TEXT}, {LOOK_TEXT}]\nThen [1, 2, 3] follows, or {{'x': 1}}.",
        f"[{ANSWER_TEXT}]\n</think>\nNo, I look first.\n[{STEP_TEXT}, {LOOK_TEXT}]",
    ],
)
def test_an_unambiguous_reply_is_parsed(text: str) -> None:
    reply = parse_reply(text)
    assert (reply.malformed, reply.calls) == ("", (STEP, LOOK))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"[{STEP_TEXT}, {LOOK_TEXT}", "breaks off before its ]"),
        (f"```json\n[{STEP_TEXT},\n  {{tool: 1}}]\n```", "a name in quotes is expected (line 3, column 4"),
        ('[{"tool": "step", "parameters": {"duration": 1/3}}]', "near '/3}}]': a comma or } is expected"),
        ('[{"tool": "step", "parameters": {"duration": NaN}}]', "near 'NaN}}]': this is no JSON value"),
        ('[{"tool": "answer", "parameters": {"answer": "2}}]', "this string does not end on its line"),
        ('[{"tool": "step", "tool": "answer"}]', "given twice"),
        (f'[{STEP_TEXT}, "get_position"]', "item 2 of the list of calls is no call"),
        ('[{"tool": "step", "duration": 1}]', 'call 1 has no "parameters"'),
        ('[{"tool": "step", "parameters": 1}]', "no JSON object"),
        ('[{"tool": "step", "parameters": {}, "args": {}}]', 'both "parameters" and "args"'),
        ('[{"tool": {"name": "step"}, "parameters": {}}]', "does not name its tool"),
        (
            '<|tool_call_begin|> functions.step:0 <|tool_call_argument_begin|> {"duration": 1} <|tool_call_end|> <|too',
            "markup",
        ),
        (
            "<|tool_calls_section_begin|><|tool_call_begin|> functions.step:0 <|tool_call_argument_begin|> "
            '{"duration": 1} <|tool_call_end|>',
            "markup",
        ),
        (
            '<|tool_call_begin|> functions.step:0 <|tool_call_argument_begin|> {"duration": 1/3} <|tool_call_end|>',
            "parameters of step are a text that is no JSON: a comma or }",
        ),
        ("<tool>get_position</tool><parameter>object_1</parameter>", "markup"),
        (f"<think>I could write [{STEP_TEXT}]", "inside <think>"),
        # The rest of a broken list is not a shorter list, even if its brackets seem to match.
        (f'[{STEP_TEXT}, "tool": "step", "parameters": {{}}}}, {LOOK_TEXT}, {ANSWER_TEXT}]', "a comma or ]"),
        (f"[{STEP_TEXT}}}, {LOOK_TEXT},\n {ANSWER_TEXT}]", "a comma or ]"),
        (f"[{STEP_TEXT}], {LOOK_TEXT}, {ANSWER_TEXT}]", "do not match"),
        (f"[{STEP_TEXT},] {LOOK_TEXT}]", "do not match"),
        (f'["tool": "step", "parameters": {{}}}}, {LOOK_TEXT}]', "do not match"),
        (f'[{{"tool": "step", ]"parameters": {{}}}}\n, {ANSWER_TEXT}]', "a name in quotes"),
        (f'[{{"tool": "step", "parameters": {{"duration": 2*3}}}}, {ANSWER_TEXT}]', "a comma or }"),
    ],
)
def test_an_ambiguous_reply_runs_nothing_and_says_why(text: str, said: str) -> None:
    reply = parse_reply(text)
    assert said in reply.malformed
    assert (reply.calls, reply.reasoning) == ((), text)


NATIVE_STEP = '<|tool_call_begin|> functions.step:0 <|tool_call_argument_begin|> {"duration": 0.5} <|tool_call_end|>'


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"[{STEP_TEXT}]\n[{LOOK_TEXT}]", "2 sets of calls, at line 1, column 1 and at line 2, column 1"),
        (f"```json\n[{STEP_TEXT}]\n```\nThen:\n```json\n[{LOOK_TEXT}]\n```", "2 sets of calls"),
        (f"```json\n[{STEP_TEXT}]\n```\n```json\n[{STEP_TEXT}]\n```", "2 sets of calls"),
        (f"```json\n[{STEP_TEXT}]\n```\nLater I will write [{ANSWER_TEXT}].", "2 sets of calls"),
        (f"[{ANSWER_TEXT}] or rather [{STEP_TEXT}, {LOOK_TEXT}]", "2 sets of calls"),
        (f"[{STEP_TEXT}], then {LOOK_TEXT}, then {ANSWER_TEXT}", "3 sets of calls, first and last at line 1, column 1"),
        (f"[{STEP_TEXT}]\n```json\n[{{'tool': x}}]\n```", "2 sets of calls"),
        (f'It returned {{"tool": "step", "parameters": {{...}}}}.\n\n[{STEP_TEXT}, {LOOK_TEXT}]', "2 sets of calls"),
        (f"{NATIVE_STEP} and then {NATIVE_STEP}", "2 sets of calls"),
        (f"{NATIVE_STEP}\n[{LOOK_TEXT}]", "2 sets of calls"),
        (f"<tool>get_position</tool>\n[{STEP_TEXT}]", "in a JSON list and in markup"),
        (f'{{"now": [{STEP_TEXT}], "later": [{LOOK_TEXT}]}}', "an object holds 2 lists of calls"),
        (
            '[{"tool": "step", "parameters": {"duration": 1}, "then": [' + LOOK_TEXT + "]}]",
            "call 1 holds further calls",
        ),
    ],
)
def test_several_sets_of_calls_run_nothing_and_the_agent_is_told(text: str, said: str) -> None:
    """The paper's rule: more than one set of calls is an error of JSON syntax."""
    reply = parse_reply(text)
    assert said in reply.malformed
    assert "one JSON list" in reply.malformed or "a JSON list of calls is needed" in reply.malformed
    assert (reply.calls, reply.reasoning) == ((), text)


@given(CALLS, CALLS, PROSE)
def test_of_two_lists_none_runs_whatever_stands_between(
    first: list[ToolCall], second: list[ToolCall], prose: str
) -> None:
    reply = parse_reply(f"{written(first)}\n{prose}\n{written(second)}")
    assert reply.calls == ()
    assert reply.malformed


@pytest.mark.parametrize(
    "text",
    [
        "",
        "It moves with v = [1.0, 0.0, -2.5] from [0, 0, 1].",
        "[]",
        '```json\n{"sim_time": 0.5, "velocity": [0, 0, -4.9]}\n```',
        '[{"name": "ball", "mass": 1}, {"name": "box", "mass": 2}]',
        f"[{STEP_TEXT}] </think> I think that is all.",
    ],
)
def test_data_and_vectors_are_not_calls(text: str) -> None:
    reply = parse_reply(text)
    assert (reply.calls, reply.malformed, reply.reasoning) == ((), "", text)


def test_a_think_tag_inside_a_call_does_not_end_the_thought() -> None:
    quoted = answer("</think>")
    text = f"I think. </think> I answer. {written([quoted])}"
    assert parse_reply(text).calls == (quoted,)
    assert parse_reply(f"{text} </think> No.").calls == ()


def test_a_call_without_arguments_may_omit_them() -> None:
    assert parse_reply('[{"tool": "find_objects"}]').calls == (call("find_objects"),)


def test_the_agent_gets_each_result_the_note_and_the_iterations_left() -> None:
    exchanges = [
        returned("step", {"sim_time": 0.5}, duration=0.5),
        refused("get_position", "no such object", object_id="object_1"),
        rejected("fly"),
        skipped("answer", answer="2"),
    ]
    assert feedback_text(Feedback(exchanges, "fly: not run.", 3)) == (
        'Returns:\n1. step(duration=0.5) -> {"sim_time":0.5}\n'
        '2. get_position(object_id="object_1") -> error: no such object\n'
        "3. fly() -> error: fits no schema\n"
        '4. answer(answer="2") -> not run\n\n'
        "fly: not run.\n\n"
        "Iterations left: 3."
    )
    assert feedback_text(Feedback([], "", 1)) == "Iterations left: 1 (the coming reply is the last)."
