"""Tests of the harness for third-party clients: the generated page, the scripted model, the detection of faults."""

import json
import sys
from pathlib import Path
from typing import Any

import anyio
import pytest

from evaluator.records.episode import Verdict
from tests.harness.clients.catalogue import PROGRAMS, Client, read_clients
from tests.harness.clients.coding_agents import read_messages_request, read_response_request
from tests.harness.clients.environments import CannotInstall
from tests.harness.clients.how_to import PAGE, current
from tests.harness.clients.playing import Played, canonical, difference, on_stdio, over_http, read_messages, rehearse
from tests.harness.clients.run import Row, cells, kept_lines, lines_of, main, rows_of
from tests.harness.clients.run import page as table_page
from tests.harness.clients.scripted_model import (
    WRONG,
    WRONG_CALLS,
    Conversation,
    app,
    next_call,
    read_gemini,
    read_openai,
    reading,
    serving,
)

RESULT: dict[str, Any] = {"sim_time": 1.5, "displacement": 0.08}
TEXT = json.dumps(RESULT, separators=(",", ":"))
REFUSED = "there is no object 'object_99'; the objects you can use are object_1"

SMALL = """
import json
import sys
import urllib.request

import anyio
from mcp import Client, StdioServerParameters, stdio_client

laboratory, task = sys.argv[1:]
where = laboratory
if not laboratory.startswith("http"):
    command, *args = laboratory.split()
    where = stdio_client(StdioServerParameters(command=command, args=args))


async def main():
    import os

    said = [{"role": "user", "content": task}]
    async with Client(where) as client:
        while True:
            body = json.dumps({"messages": said}).encode()
            url = os.environ["OPENAI_BASE_URL"] + "/chat/completions"
            with urllib.request.urlopen(urllib.request.Request(url, body)) as reply:
                message = json.load(reply)["choices"][0]["message"]
            if "tool_calls" not in message:
                return print(message["content"])
            function = message["tool_calls"][0]["function"]
            arguments = json.loads(function["arguments"])
            FAULT
            result = await client.call_tool(function["name"], arguments)
            said += [message, {"role": "tool", "content": result.content[0].text}]


anyio.run(main)
"""


@pytest.fixture(scope="module")
def expected() -> Played:
    return anyio.run(rehearse, 23)


@pytest.fixture(scope="module")
def provider() -> Any:
    with serving(app()) as url:
        yield url


def program(folder: Path, fault: str = "pass") -> list[str]:
    file = folder / "small.py"
    file.write_text(SMALL.replace("FAULT", fault), encoding="utf-8")
    return [sys.executable, str(file)]


def test_the_page_shows_the_programs_that_are_run(update_goldens: bool) -> None:
    if update_goldens:
        PAGE.write_text(current(), encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == current()
    assert {client.program for client in read_clients()} == {file.name for file in PROGRAMS.iterdir() if file.is_file()}


def test_the_expected_play_is_refused_then_finds_measures_and_is_right(expected: Played) -> None:
    tools = [call["tool"] for call in expected.transcript]
    assert tools == ["get_position"] * 3 + ["find_objects", "apply_force", "step", "get_displacement", "answer"]
    assert expected.grade is not None
    assert expected.grade.strict is Verdict.CORRECT


@pytest.mark.parametrize(
    "returned",
    [
        TEXT,
        f"Observation:\n{TEXT}",
        [{"type": "text", "text": TEXT}],
        json.dumps({"type": "text", "text": TEXT, "annotations": None}),
        {"name": "get_displacement", "response": {"content": [{"type": "text", "text": TEXT}], "isError": False}},
        f"meta=None content=[TextContent(type='text', text='{TEXT}', annotations=None)] isError=False",
        [["1. it moved", {"result": TEXT}]],
    ],
)
def test_the_model_finds_a_result_in_every_representation_of_a_client(returned: Any) -> None:
    assert reading(returned) == RESULT


@pytest.mark.parametrize(
    "returned", [REFUSED, f"Error: {REFUSED}", {"error": REFUSED}, [{"type": "text", "text": REFUSED}]]
)
def test_the_model_recognises_a_refusal(returned: Any) -> None:
    assert "object_99" in reading(returned)["error"]


def test_the_model_continues_only_if_it_gets_the_reason_of_a_refusal(expected: Played) -> None:
    with_reasons = Conversation(expected.prompt, (REFUSED,) * WRONG_CALLS, frozenset())
    assert next_call(Conversation(expected.prompt, (), frozenset())) == WRONG
    after = next_call(with_reasons)
    assert after is not None
    assert after.tool == "find_objects"
    with pytest.raises(ValueError, match="did not return why"):
        next_call(Conversation(expected.prompt, ("tool failed",), frozenset()))
    with pytest.raises(ValueError, match="names no scene"):
        next_call(Conversation("Hello.", (REFUSED,) * WRONG_CALLS, frozenset()))
    with pytest.raises(ValueError, match="cannot use"):
        next_call(Conversation(expected.prompt, (*(REFUSED,) * WRONG_CALLS, "no such tool"), frozenset()))


def test_both_wire_formats_give_the_same_conversation() -> None:
    chat = {
        "messages": [
            {"role": "system", "content": "Act."},
            {"role": "user", "content": [{"type": "text", "text": "Task"}]},
            {"role": "assistant", "tool_calls": [{"id": "1"}], "content": None},
            {"role": "tool", "tool_call_id": "1", "content": TEXT},
        ],
        "tools": [{"type": "function", "function": {"name": "step"}}],
    }
    response = {"functionResponse": {"name": "step", "response": {"result": TEXT}}}
    gemini = {
        "contents": [
            {"role": "user", "parts": [{"text": "Act.\n\nTask"}]},
            {"role": "model", "parts": [{"functionCall": {"name": "step", "args": {}}}]},
            {"role": "user", "parts": [response]},
        ],
        "tools": [{"functionDeclarations": [{"name": "step"}]}],
    }
    first, second = read_openai(chat), read_gemini(gemini)
    assert first.task == second.task == "Act.\n\nTask"
    assert first.tools == second.tools == {"step"}
    assert list(map(reading, first.returns)) == list(map(reading, second.returns)) == [RESULT]


def test_the_formats_of_coding_agents_give_the_same_conversation() -> None:
    call = {"type": "tool_use", "id": "toolu_0", "name": "mcp__physment__step", "input": {}}
    result = {"type": "tool_result", "tool_use_id": "toolu_0", "content": [{"type": "text", "text": TEXT}]}
    messages = {
        "messages": [
            {"role": "user", "content": [{"type": "text", "text": "Act."}, {"type": "text", "text": "Task"}]},
            {"role": "assistant", "content": [call]},
            {"role": "user", "content": [result, {"type": "text", "text": "<reminder>"}]},
        ],
        "tools": [{"name": "mcp__physment__step"}],
    }
    responses = {
        "input": [
            {"type": "message", "role": "developer", "content": [{"type": "input_text", "text": "Act."}]},
            {"type": "message", "role": "user", "content": [{"type": "input_text", "text": "Task"}]},
            {"type": "tool_search_call", "call_id": "search_0"},
            {"type": "tool_search_output", "call_id": "search_0", "tools": [{"type": "namespace", "name": "step"}]},
            {"type": "function_call", "name": "step", "arguments": "{}", "call_id": "call_0"},
            {"type": "function_call_output", "call_id": "call_0", "output": f"Wall time: 0.1 s\n{TEXT}"},
        ]
    }
    first, second = read_messages_request(messages), read_response_request(responses)
    assert first.task == second.task == "Act.\n\nTask"
    assert list(map(reading, first.returns)) == list(map(reading, second.returns)) == [RESULT]
    assert (first.tools, second.tools) == ({"mcp__physment__step"}, {"step"})


def test_a_client_over_http_is_compared_with_the_expected_play(tmp_path: Path, provider: str, expected: Played) -> None:
    seen = over_http(program(tmp_path), [23], provider, "/usr/bin:/bin")[23]
    assert difference(seen, expected) == ""
    assert seen.protocols == {"2026-07-28"}


def test_a_client_on_stdio_is_compared_with_the_expected_play(tmp_path: Path, provider: str, expected: Played) -> None:
    seen = on_stdio(program(tmp_path), 23, expected.prompt, provider, "/usr/bin:/bin")
    assert difference(seen, expected) == ""
    assert (seen.protocols, seen.processes) == ({"2026-07-28"}, 1)


def test_a_client_that_changes_a_call_is_detected(tmp_path: Path, provider: str, expected: Played) -> None:
    fault = 'arguments |= {"duration": 14.0} if function["name"] == "step" else {}'
    seen = on_stdio(program(tmp_path, fault), 23, expected.prompt, provider, "/usr/bin:/bin")
    assert difference(seen, expected).startswith('call 6 is {"tool": "step", "arguments": {"duration": 14.0}')


def test_a_client_that_crashes_is_a_failure_with_its_last_line(tmp_path: Path, provider: str, expected: Played) -> None:
    fault = 'assert function["name"] != "step", "I will not wait"'
    seen = on_stdio(program(tmp_path, fault), 23, expected.prompt, provider, "/usr/bin:/bin")
    assert difference(seen, expected).startswith("call 6 is missing")
    assert "I will not wait" in difference(seen, expected)


def test_a_different_grade_is_a_difference(expected: Played) -> None:
    assert expected.grade is not None
    worse = expected.grade.model_copy(update={"strict": Verdict.INCORRECT})
    assert difference(Played(expected.transcript, worse), expected).startswith("the grade is")


def test_calls_and_versions_are_read_from_the_messages() -> None:
    def said(process: int, speaker: str, **message: Any) -> dict[str, Any]:
        return {"process": process, "speaker": speaker, "message": {"jsonrpc": "2.0", **message}}

    result = {"content": [{"type": "text", "text": TEXT}], "structuredContent": RESULT, "isError": False}
    messages = [
        said(1, "client", id=0, method="initialize", params={"protocolVersion": "2025-11-25"}),
        said(1, "laboratory", id=0, result={"protocolVersion": "2025-06-18"}),
        said(1, "client", id=1, method="tools/call", params={"name": "step", "arguments": {"duration": 1}}),
        said(2, "client", id=1, method="tools/list"),
        said(2, "laboratory", id=1, result={"tools": []}),
        said(1, "laboratory", id=1, result=result),
    ]
    exchanges, versions = read_messages(messages)
    assert versions == {"2025-06-18"}
    assert list(map(canonical, exchanges)) == [{"tool": "step", "arguments": {"duration": 1}, "result": RESULT}]


def test_a_client_that_cannot_be_installed_has_a_row_with_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_client: Client) -> None:
        raise CannotInstall("pip: no such version")

    monkeypatch.setattr("tests.harness.clients.run.environment_of", fail)
    client = Client(name="None", package="none", program="mcp_1_client.py", requirements=(), know="Nothing.")
    (row,) = rows_of(client, {}, "http://127.0.0.1:1")
    assert cells(row) == ("None", "–", "–", "–", "NO", "cannot be installed: pip: no such version")


def test_a_client_that_fails_makes_the_command_fail_and_writes_no_page(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    client = Client(name="X", package="x", program="x.py", requirements=(), scenes=(), know="Nothing.")
    works = {True: "", False: "call 1 is missing"}

    def run_as(good: bool) -> int:
        row = Row("X", "1", "HTTP", "2026-07-28", good, works[good], "Nothing.")
        monkeypatch.setattr("tests.harness.clients.run.rows_of", lambda *_: [row])
        return main(["--out", str(tmp_path / "page.md")])

    monkeypatch.setattr("tests.harness.clients.run.read_clients", lambda: (client,))
    assert run_as(good=False) == 1
    assert "call 1 is missing" in capsys.readouterr().out
    assert not (tmp_path / "page.md").exists()
    assert run_as(good=True) == 0
    assert "| X | 1 | HTTP | 2026-07-28 | yes | Nothing. |" in (tmp_path / "page.md").read_text(encoding="utf-8")
    assert main(["no such client"]) == 1


def test_the_table_says_which_clients_need_a_host() -> None:
    row = Row("A | B", "1.0", "stdio", "2025-11-25", works=True, why="starts a process for each call", know="So it is.")
    assert "| A \\| B | 1.0 | stdio | 2025-11-25 | host only | So it is. |" in table_page(lines_of([row]))


def test_a_run_of_some_clients_keeps_the_rows_of_the_others(tmp_path: Path) -> None:
    first, second = (client.name for client in read_clients()[:2])
    rows = [
        Row(name, "1.0", transport, "2025-11-25", works=True, why="", know="A | B.")
        for name in (first, second)
        for transport in ("HTTP", "stdio")
    ]
    file = tmp_path / "page.md"
    file.write_text(table_page(lines_of(rows)), encoding="utf-8")
    assert kept_lines(file, []) == lines_of(rows)
    newer = Row(second, "2.0", "HTTP", "2026-07-28", works=True, why="", know="C.")
    assert kept_lines(file, [newer]) == [*lines_of(rows[:2]), *lines_of([newer])]
