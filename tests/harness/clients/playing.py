"""Plays scenes through a third-party client and compares its calls and results with those of the evaluator's client.

Over HTTP, the evaluator records the calls as those of an external agent. On stdio, a process between the client and
the laboratory records them.
"""

import contextlib
import itertools
import json
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evaluator.answers.grading import grade
from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import ProcessConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import ANSWER, Briefing, Feedback, Reply
from evaluator.records.episode import Episode, EpisodeKey, Exchange, Grade, ToolCall, Versions
from evaluator.store.run_folder import RunFolder
from tests.harness.clients.scripted_model import KEY, Conversation, next_call

HERE = Path(__file__).parent
LABORATORY = (sys.executable, "-m", "physment_mcp")
MAX_WALL_S = 120.0
"""Greatest wall time for a program to play one scene [s]."""


@dataclass(frozen=True, slots=True)
class Played:
    """One scene as the laboratory recorded it."""

    transcript: tuple[Mapping[str, Any], ...]
    """Calls and results in canonical form: no times, no ids."""
    grade: Grade | None
    """None if there was no answer."""
    prompt: str = ""
    failure: str = ""
    """The reason why there was no answer."""
    protocols: frozenset[str] = frozenset()
    """MCP protocol versions used."""
    processes: int = 1
    """Number of laboratory processes that were started."""


@dataclass(frozen=True, slots=True)
class Rehearsed:
    """The scripted model as an agent of the evaluator, with which the calls of every client are compared."""

    name: str = "rehearsed"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_Rehearsal":
        del key
        return _Rehearsal(briefing.prompt)


@dataclass(slots=True)
class _Rehearsal:
    task: str
    returns: list[Any] = field(default_factory=list[Any])

    async def act(self, feedback: Feedback | None) -> Reply:
        self.returns += [exchange.text for exchange in feedback.exchanges] if feedback else []
        call = next_call(Conversation(self.task, tuple(self.returns), frozenset()))
        assert call is not None, "the episode ends with the answer"
        return Reply(calls=(ToolCall(tool=call.tool, arguments=call.arguments),))


async def rehearse(scene: int) -> Played:
    """Play a scene with the evaluator's own client on stdio; returns the expected play."""
    key = EpisodeKey(scene=scene, seed=0, agent="rehearsed", budget=20)
    async with ProcessConnector(LABORATORY).open(scene, 0) as client:
        episode = await play_episode(Rehearsed(), client, key, Versions(physment="0", protocol="0", pack="0"))
    return played(scene, exchanges_of(episode), prompt=episode.prompt)


def exchanges_of(episode: Episode) -> list[Exchange]:
    """The calls of all turns, in order."""
    return [exchange for turn in episode.turns for exchange in turn.exchanges]


def played(scene: int, exchanges: Sequence[Exchange], **facts: Any) -> Played:
    """The transcript of calls and results, and the grade of the answer."""
    submitted = [exchange for exchange in exchanges if exchange.call.tool == ANSWER and not exchange.is_error]
    answers = [exchange.call.arguments["answer"] for exchange in submitted]
    return Played(
        tuple(map(canonical, exchanges)),
        grade(answers[0], KeyRing().key(scene, 0)) if answers else None,
        **facts,
    )


def canonical(exchange: Exchange) -> dict[str, Any]:
    """Return a call and its result without the parts that differ between runs."""
    result = {"refused": exchange.text} if exchange.is_error else {"result": exchange.content}
    return {"tool": exchange.call.tool, "arguments": exchange.call.arguments, **result}


def over_http(command: Sequence[str], scenes: Iterable[int], provider: str, path: str) -> dict[int, Played]:
    """Run a program as an external agent of the evaluator.

    Args:
        command: The program; the address of the episode and the opening prompt are appended.
        scenes: The scenes to play.
        provider: Address of the model.
        path: Value of PATH for the program.

    Returns:
        Scene → what the laboratory recorded.
    """
    with tempfile.TemporaryDirectory() as scratch:
        notes, run = Path(scratch) / "posts.jsonl", RunFolder(Path(scratch) / "run")
        with _host(notes) as url:
            words = ["run", "--agent", "external", "--server", url, "--scenes", ",".join(map(str, scenes))]
            words += [
                "--max-wall-time",
                str(MAX_WALL_S),
                "--out",
                str(run.path),
                "--",
                *command,
                "{mcp_url}",
                "{prompt}",
            ]
            done = subprocess.run(
                [sys.executable, "-m", "evaluator", *words],
                env=_environment(provider, path), capture_output=True, text=True, check=False,
            )  # fmt: skip
            assert run.episodes_file.exists(), done.stderr
        grades, protocols = run.grades(), _versions_posted(notes)
        return {
            key.scene: Played(
                tuple(map(canonical, exchanges_of(episode))),
                grades[key].grade if episode.answer is not None else None,
                failure=" — ".join([part for part in (episode.error, _last_words(episode)) if part]),
                protocols=protocols,
            )
            for key, episode in run.episodes().items()
        }


def _last_words(episode: Episode) -> str:
    return _last_line(episode.turns[-1].reasoning) if episode.turns else ""


def _last_line(text: str) -> str:
    """Return the last non-empty line of a program's output, without the frame that Python draws around exceptions."""
    lines = [line.strip(" |+-") for line in text.splitlines()]
    return next((line[:200] for line in reversed(lines) if line), "")


@contextlib.contextmanager
def _host(notes: Path) -> Generator[str]:
    command = [sys.executable, str(HERE / "watched_host.py"), str(notes)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as host:
        assert host.stdout is not None
        try:
            yield json.loads(host.stdout.readline())["listening"]
        finally:
            host.terminate()


def _versions_posted(notes: Path) -> frozenset[str]:
    """Return the protocol versions in the headers of tool calls; versions before 2025-06-18 have no such header."""
    posts = [json.loads(line) for line in notes.read_text().splitlines()] if notes.exists() else []
    # Other requests come from the evaluator, which calls no tool.
    return frozenset(post["version"] or "2025-03-26" for post in posts if post["method"] == "tools/call")


def on_stdio(command: Sequence[str], scene: int, prompt: str, provider: str, path: str) -> Played:
    """Run a program that starts the laboratory itself and plays a scene on stdio.

    Args:
        command: The program; the command of the laboratory and the opening prompt are appended.
        scene: The scene to play.
        prompt: The opening prompt.
        provider: Address of the model.
        path: Value of PATH for the program.
    """
    with tempfile.TemporaryDirectory() as scratch:
        notes = Path(scratch) / "messages.jsonl"
        watched = [sys.executable, str(HERE / "watched_process.py"), str(notes), *LABORATORY, "--scene", str(scene)]
        words = [*command, shlex.join(watched), prompt]
        try:
            done = subprocess.run(
                words, cwd=scratch, env=_environment(provider, path) | {"HOME": scratch}, timeout=MAX_WALL_S,
                stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
            )  # fmt: skip
            said = _last_line(done.stderr if done.returncode else done.stdout)
            failure = f"ended with code {done.returncode}: {said}"
        except subprocess.TimeoutExpired:
            failure = f"did not end within {MAX_WALL_S:g} s"
        messages = [json.loads(line) for line in notes.read_text().splitlines()] if notes.exists() else []
    exchanges, protocols = read_messages(messages)
    processes = len({note["process"] for note in messages})
    return played(scene, exchanges, prompt=prompt, failure=failure, protocols=protocols, processes=processes)


def read_messages(messages: Iterable[Mapping[str, Any]]) -> tuple[list[Exchange], frozenset[str]]:
    """Extract the tool calls and the protocol versions from the messages of a client and a laboratory."""
    calls: dict[tuple[int, Any], Mapping[str, Any]] = {}
    exchanges: list[Exchange] = []
    versions: set[str] = set()
    for note in messages:
        message, ident = note["message"], (note["process"], note["message"].get("id"))
        params, result = message.get("params") or {}, message.get("result") or {}
        if note["speaker"] == "client" and message.get("method") == "tools/call":
            calls[ident] = params
            stated = (params.get("_meta") or {}).get("io.modelcontextprotocol/protocolVersion")
            versions |= {stated} if stated else set()
        elif note["speaker"] == "laboratory" and "protocolVersion" in result:
            versions.add(result["protocolVersion"])
        elif note["speaker"] == "laboratory" and ident in calls:
            call = calls.pop(ident)
            exchanges.append(
                Exchange(
                    call=ToolCall(tool=call["name"], arguments=call.get("arguments") or {}),
                    returned=True,
                    is_error=result.get("isError", False),
                    content=result.get("structuredContent"),
                    text="\n".join(part.get("text", "") for part in result.get("content", ())),
                )
            )
    return exchanges, frozenset(versions)


def difference(seen: Played, expected: Played) -> str:
    """The first difference between a client's play and the expected one; empty if there is none."""
    pairs = itertools.zip_longest(seen.transcript, expected.transcript)
    for number, (got, wanted) in enumerate(pairs, start=1):
        if got != wanted:
            why = f"; {seen.failure}" if got is None and seen.failure else ""
            return f"call {number} is {_short(got)}, not {_short(wanted)}{why}"
    if seen.grade != expected.grade:
        return f"the grade is {seen.grade}, not {expected.grade}"
    return ""


def _short(call: Mapping[str, Any] | None) -> str:
    return json.dumps(call)[:160] if call else "missing"


def _environment(provider: str, path: str) -> dict[str, str]:
    """The environment variables of a program; the vendors' clients find the model's address and key in them."""
    kept = {name: os.environ[name] for name in ("HOME", "LANG", "TMPDIR", "SSL_CERT_FILE") if name in os.environ}
    model = {"OPENAI_BASE_URL": f"{provider}/v1", "OPENAI_API_KEY": KEY}
    gemini = {"GOOGLE_GEMINI_BASE_URL": provider, "GOOGLE_API_KEY": KEY}
    anthropic = {"ANTHROPIC_BASE_URL": provider, "ANTHROPIC_API_KEY": KEY}
    return {**kept, **model, **gemini, **anthropic, "PATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
