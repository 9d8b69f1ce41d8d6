"""The paper's text protocol: a reply is prose with one JSON list of calls, and results are returned as text.

Only text after the last `</think>` can contain calls. There they may be one list of call objects, a sequence of single
call objects, or the markup that some models fall back to (`<|tool_call_begin|> functions.step:0 …`). The key of the
tool is `tool`, `name` or `function`; the key of the arguments is `parameters`, `arguments`, `args` or `input`.
`lenient_json` describes the accepted JSON.

The parser never guesses. Nothing runs, and the agent is told why, if a reply has several sets of calls, readable or
not; if an item of the list is not a call; if arguments are outside `parameters`; or if the JSON is broken. The
paper's rule makes several sets an error: see docs/decisions/0040-one-set-of-calls.md.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from pydantic import JsonValue

from evaluator.episode.player import Feedback, Reply
from evaluator.episode.protocols.lenient_json import JsonSpan, find_json, read_json
from evaluator.records.episode import Exchange, ToolCall

_PARAMETERS = ("parameters", "arguments", "args", "input")
_END_OF_THOUGHT = "</think>"
_FENCE = re.compile(r"```[ \t]*(\w*)")
_NAMED = re.compile(r"""["']?(?:tool|name|function|tool_calls)["']?\s{0,20}:""")
_NATIVE = re.compile(
    r"<\|tool_call_begin\|>\s{0,20}(?:functions\.)?(\w+)(?::\d+)?\s{0,20}<\|tool_call_argument_begin\|>"
    r"((?:(?!<\|).)*+)<\|tool_call_end\|>",
    re.DOTALL,
)
_CLOSING = re.compile(r"\s*+[\]}]")
_UNMATCHED = "the brackets of the list of calls do not match"
_MARKUP = re.compile(r"<\|tool_call|</?tool_call>|<tool>|<function=")
_CALL_IN_MARKUP = re.compile(r"<\|tool_call_begin\|>|<tool>|<function=")
_IN_MARKUP = "calls stand in markup where a JSON list of calls is needed"
_NATIVE_SIGNS = re.compile(r"<\|tool_calls_section_(?:begin|end)\|>")


@dataclass(frozen=True, slots=True)
class _Attempt:
    """A part of a reply that contains calls, valid or broken."""

    start: int
    end: int
    calls: tuple[ToolCall, ...] = ()
    problem: str = ""
    problem_at: int = 0


class _NotACallError(Exception):
    """A JSON value among the calls is not a call; the message says why."""


def parse_reply(text: str) -> Reply:
    """Parse a reply of the text protocol. Never raises; takes linear time.

    Args:
        text: The reply as the model wrote it.

    Returns:
        The prose as `reasoning`, and the calls. If the calls cannot be parsed, `reasoning` is the whole text and
        `malformed` is the reason. If there are no calls, `reasoning` is the whole text.
    """
    start = _end_of_thought(text)
    if start == 0 and text.lstrip().startswith("<think>"):
        return Reply(reasoning=text, malformed="it ends inside <think>, before any call")
    found = sorted([*_attempts(text, start), *_native(text, start)], key=lambda attempt: attempt.start)
    if not found:
        return Reply(reasoning=text, malformed=_IN_MARKUP if _MARKUP.search(text, start) else "")
    if len(found) > 1:
        places = " and at ".join(_line_and_column(text, attempt.start) for attempt in (found[0], found[-1]))
        which = "" if len(found) == 2 else "first and last "
        problem = f"it has {len(found)} sets of calls, {which}at {places}; write all calls in one JSON list"
        return Reply(reasoning=text, malformed=problem)
    (chosen,) = found
    if _CALL_IN_MARKUP.search(text[start : chosen.start]) or _CALL_IN_MARKUP.search(text, chosen.end):
        return Reply(reasoning=text, malformed=f"it has calls in a JSON list and in markup; {_IN_MARKUP}")
    if chosen.problem:
        return Reply(
            reasoning=text, malformed=f"{chosen.problem} ({_line_and_column(text, chosen.problem_at)} of your reply)"
        )
    return Reply(reasoning=_prose(text, chosen), calls=chosen.calls)


def feedback_text(feedback: Feedback) -> str:
    """Format the feedback after a turn: each call with its result, the loop's note, and the remaining iterations."""
    lines = [f"{number}. {_exchange_text(exchange)}" for number, exchange in enumerate(feedback.exchanges, start=1)]
    blocks = ["Returns:\n" + "\n".join(lines)] if lines else []
    if feedback.note:
        blocks.append(feedback.note)
    last = " (the coming reply is the last)" if feedback.remaining == 1 else ""
    blocks.append(f"Iterations left: {feedback.remaining}{last}.")
    return "\n\n".join(blocks)


def _exchange_text(exchange: Exchange) -> str:
    call = exchange.call
    arguments = ", ".join(f"{name}={_json(value)}" for name, value in call.arguments.items())
    result = f"error: {exchange.text}" if exchange.is_error else exchange.text
    return f"{call.tool}({arguments}) -> {result if exchange.returned or exchange.is_error else 'not run'}"


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def _end_of_thought(text: str) -> int:
    """Return the position after the last `</think>` outside a call; 0 if there is none."""
    at = text.rfind(_END_OF_THOUGHT)
    if at < 0:
        return 0
    with_calls = [attempt for attempt in _attempts(text, 0) if not attempt.problem]
    while with_calls and at >= 0:
        attempt = with_calls.pop()
        if attempt.start < at < attempt.end:
            at = text.rfind(_END_OF_THOUGHT, 0, attempt.start)
    return at + len(_END_OF_THOUGHT) if at >= 0 else 0


def _attempts(text: str, start: int) -> list[_Attempt]:
    """Return all parts with calls. Consecutive single call objects form one part."""
    places: list[list[_Attempt]] = []
    for found in find_json(text, start):
        attempt = _attempt(text, found)
        if attempt is None:
            continue
        gap = text[places[-1][-1].end : attempt.start] if places else "-"
        are_lists = bool(places) and text[places[-1][0].start] == "[" == text[attempt.start]
        if gap.strip(" \t\r\n,;]}") or (are_lists and not gap.strip()):
            places.append([attempt])
            continue
        # A missing or extra bracket splits a list into adjacent pieces; none of them is the whole list.
        are_objects = text[places[-1][0].start] == "{" == text[attempt.start]
        if not are_objects or gap.strip(" \t\r\n,;"):
            attempt = replace(attempt, problem=attempt.problem or _UNMATCHED, problem_at=attempt.start)
        places[-1].append(attempt)
    return [_joined(text, place) for place in places]


def _joined(text: str, place: Sequence[_Attempt]) -> _Attempt:
    start, end = place[0].start, place[-1].end
    broken = next((attempt for attempt in place if attempt.problem), None)
    if broken is not None:
        return replace(broken, start=start, end=end, calls=())
    if text[start] == "{" and _CLOSING.match(text, end):
        return _Attempt(start, end, (), _UNMATCHED, end)
    return _Attempt(start, end, tuple(call for attempt in place for call in attempt.calls))


def _attempt(text: str, found: JsonSpan) -> _Attempt | None:
    """Convert a JSON value to calls or to a problem; None if it does not look like calls."""
    if found.problem:
        if not _NAMED.search(text, found.start, found.end):
            return None
        near = text[found.problem_at : found.problem_at + 20].split("\n", 1)[0].strip()
        problem = f"the JSON is broken{f' near {near!r}' if near else ''}: {found.problem}"
        return _Attempt(found.start, found.end, (), problem, found.problem_at)
    try:
        calls = _calls(found.value)
    except _NotACallError as error:
        return _Attempt(found.start, found.end, (), str(error), found.start)
    return _Attempt(found.start, found.end, calls) if calls else None


def _line_and_column(text: str, at: int) -> str:
    return f"line {text.count(chr(10), 0, at) + 1}, column {at - text.rfind(chr(10), 0, at)}"


def _calls(value: JsonValue) -> tuple[ToolCall, ...]:
    """Convert a JSON value to calls; empty if it is other data.

    Raises:
        _NotACallError: Only some items are calls, or a call is incomplete.
    """
    if isinstance(value, dict):
        if _is_call(value):
            return (_call(value, 1),)
        lists = [calls for part in value.values() if isinstance(part, list) and (calls := _calls(part))]
        if len(lists) > 1:
            raise _NotACallError(f"an object holds {len(lists)} lists of calls; write all calls in one JSON list")
        return lists[0] if lists else ()
    if not isinstance(value, list) or not any(isinstance(item, dict) and _is_call(item) for item in value):
        return ()
    return tuple(_call(item, number) for number, item in enumerate(value, start=1))


def _is_call(value: Mapping[str, JsonValue]) -> bool:
    if "tool" in value:
        return True
    # Other data, such as the laboratory's objects, may have a `name`; only with arguments is it the name of a tool.
    named = "name" in value and any(name in value for name in _PARAMETERS)
    return named or (
        "function" in value and (isinstance(value["function"], dict) or any(name in value for name in _PARAMETERS))
    )


def _call(value: JsonValue, number: int) -> ToolCall:
    if not isinstance(value, dict) or not _is_call(value):
        raise _NotACallError(f"item {number} of the list of calls is no call")
    inner = value.get("function")
    if isinstance(inner, dict) and "tool" not in value:
        return _call({"tool": inner.get("name"), **{key: part for key, part in inner.items() if key != "name"}}, number)
    tool = next(value[name] for name in ("tool", "name", "function") if name in value)
    if not isinstance(tool, str) or not tool.strip():
        raise _NotACallError(f"call {number} does not name its tool")
    given = [name for name in _PARAMETERS if name in value]
    if len(given) > 1:
        raise _NotACallError(f'call {number} has both "{given[0]}" and "{given[1]}"')
    if not given and len(value) > 1:
        raise _NotACallError(f'call {number} has no "parameters"')
    if any(_calls(part) for name, part in value.items() if name not in _PARAMETERS and isinstance(part, dict | list)):
        raise _NotACallError(f"call {number} holds further calls; write all calls in one JSON list")
    return ToolCall(tool=tool.strip(), arguments=_arguments(value[given[0]] if given else {}, f"of call {number}"))


def _arguments(value: JsonValue, whose: str) -> dict[str, JsonValue]:
    if isinstance(value, str):
        try:
            value = read_json(value)
        except ValueError as error:
            raise _NotACallError(f"the parameters {whose} are a text that is no JSON: {error}") from None
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise _NotACallError(f"the parameters {whose} are no JSON object")
    return value


def _native(text: str, start: int) -> list[_Attempt]:
    """Parse calls in a model's native markup, which delimits the tool's name and its JSON arguments unambiguously.

    Calls that are separated by other text than markup and white space do not form one list, so the reply is rejected as
    several sets of calls.
    """
    matches = list(_NATIVE.finditer(text, start))
    # If any markup is left over, a part of it is damaged and a call may be missing.
    rest = _NATIVE.sub("", text[start:])
    sections = len(_NATIVE_SIGNS.findall(rest))
    if not matches or sections % 2 or "<|" in _NATIVE_SIGNS.sub("", rest):
        return []
    sets: list[_Attempt] = []
    for match in matches:
        attempt = _native_call(match)
        if sets and not text[sets[-1].end : attempt.start].strip():
            attempt = _joined(text, [sets.pop(), attempt])
        sets.append(attempt)
    return sets


def _native_call(match: re.Match[str]) -> _Attempt:
    try:
        call = ToolCall(tool=match[1], arguments=_arguments(match[2], f"of {match[1]}"))
    except _NotACallError as error:
        return _Attempt(match.start(), match.end(), (), str(error), match.start())
    return _Attempt(match.start(), match.end(), (call,))


def _prose(text: str, chosen: _Attempt) -> str:
    """Return the reply without its calls and the code fences or markup around them."""
    before, after = text[: chosen.start].rstrip(), text[chosen.end :].lstrip()
    opening = before.rfind("```")
    if opening >= 0 and _FENCE.fullmatch(before[opening:]):
        before, after = before[:opening].rstrip(), after.removeprefix("```").lstrip()
    before, after = (_NATIVE_SIGNS.sub("", part).strip() for part in (before, after))
    return "\n\n".join(part for part in (before, after) if part)
