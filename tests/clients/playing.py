"""Plays the scenes through one client, and tells whether the laboratory saw what it sees of anybody else.

What counts is what the laboratory was asked and what it returned, taken down on its own side: over HTTP in the
evaluator's records of an external agent, on stdio by a process in between.
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

from scripted_model import KEY, Asked, next_call

from evaluator.answers.grading import grade
from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import ProcessLaboratory
from evaluator.episode.loop import play_episode
from evaluator.episode.player import ANSWER, Briefing, Feedback, Reply
from evaluator.records import Episode, EpisodeKey, Exchange, Grade, ToolCall, Versions
from evaluator.store import RunFolder

HERE = Path(__file__).parent
LABORATORY = (sys.executable, "-m", "physment_mcp")
MAX_WALL_S = 120.0
"""Wall time for a program to play one scene [s]."""


@dataclass(frozen=True, slots=True)
class Played:
    """One scene, as the laboratory saw it."""

    transcript: tuple[Mapping[str, Any], ...]
    """Its calls and returns in canonical form: no times, no ids."""
    grade: Grade | None
    """None where there was no answer."""
    prompt: str = ""
    failure: str = ""
    """Why there was no answer."""
    protocols: frozenset[str] = frozenset()
    """MCP protocol versions spoken."""
    processes: int = 1
    """Laboratories that were started for it."""


@dataclass(frozen=True, slots=True)
class Rehearsed:
    """The scripted model as an agent of the evaluator: what clients are compared with."""

    name: str = "rehearsed"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_Rehearsal":
        del key
        return _Rehearsal(briefing.prompt)


@dataclass(slots=True)
class _Rehearsal:
    task: str
    returns: list[Any] = field(default_factory=list[Any])

    async def act(self, feedback: Feedback | None) -> Reply:
        self.returns += [one.text for one in feedback.exchanges] if feedback else []
        call = next_call(Asked(self.task, tuple(self.returns), frozenset()))
        assert call is not None, "the episode ends with the answer"
        return Reply(calls=(ToolCall(tool=call.tool, arguments=call.arguments),))


async def rehearse(scene: int) -> Played:
    """Play a scene with the evaluator's own client, on stdio."""
    key = EpisodeKey(scene=scene, seed=0, agent="rehearsed", budget=20)
    async with ProcessLaboratory(LABORATORY).open(scene, 0) as client:
        episode = await play_episode(Rehearsed(), client, key, Versions(physment="0", protocol="0", pack="0"))
    return played(scene, exchanges_of(episode), prompt=episode.prompt)


def exchanges_of(episode: Episode) -> list[Exchange]:
    """The calls of all turns, in order."""
    return [one for turn in episode.turns for one in turn.exchanges]


def played(scene: int, exchanges: Sequence[Exchange], **facts: Any) -> Played:
    """What calls and returns amount to: a transcript and the grade of the answer."""
    answers = [one.call.arguments["answer"] for one in exchanges if one.call.tool == ANSWER and not one.is_error]
    return Played(
        tuple(canonical(one) for one in exchanges),
        grade(answers[0], KeyRing().key(scene, 0)) if answers else None,
        **facts,
    )


def canonical(one: Exchange) -> dict[str, Any]:
    """A call and its return without what differs from run to run."""
    said = {"refused": one.text} if one.is_error else {"result": one.content}
    return {"tool": one.call.tool, "arguments": one.call.arguments, **said}


def over_http(command: Sequence[str], scenes: Iterable[int], provider: str, path: str) -> dict[int, Played]:
    """Let a program play as an external agent of the evaluator.

    Args:
        command: The program; the address of the episode and the opening prompt are put after it.
        scenes: Which scenes.
        provider: Address of the model.
        path: Where the program finds others.

    Returns:
        For each scene, what the laboratory saw.
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
                tuple(canonical(one) for one in exchanges_of(episode)),
                grades[key].grade if episode.answer is not None else None,
                failure=" — ".join([part for part in (episode.error, _last_words(episode)) if part]),
                protocols=protocols,
            )
            for key, episode in run.episodes().items()
        }


def _last_words(episode: Episode) -> str:
    return _last_line(episode.turns[-1].reasoning) if episode.turns else ""


def _last_line(text: str) -> str:
    """The last line that says something; those of exception groups stand in frames."""
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
    """The versions that came with tool calls; the header was not there before 2025-06-18."""
    posts = [json.loads(line) for line in notes.read_text().splitlines()] if notes.exists() else []
    # The evaluator itself asks for the prompt and looks at the server, and calls no tool.
    return frozenset(one["version"] or "2025-03-26" for one in posts if one["method"] == "tools/call")


def on_stdio(command: Sequence[str], scene: int, prompt: str, provider: str, path: str) -> Played:
    """Let a program play a scene in a laboratory that it starts itself.

    Args:
        command: The program; the command of the laboratory and the opening prompt are put after it.
        scene: Which scene.
        prompt: The opening prompt.
        provider: Address of the model.
        path: Where the program finds others.
    """
    with tempfile.TemporaryDirectory() as scratch:
        notes = Path(scratch) / "messages.jsonl"
        watched = [sys.executable, str(HERE / "watched_process.py"), str(notes), *LABORATORY, "--scene", str(scene)]
        words = [*command, shlex.join(watched), prompt]
        try:
            done = subprocess.run(
                words, cwd=scratch, env=_environment(provider, path), timeout=MAX_WALL_S,
                stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
            )  # fmt: skip
            said = _last_line(done.stderr if done.returncode else done.stdout)
            failure = f"ended with code {done.returncode}: {said}"
        except subprocess.TimeoutExpired:
            failure = f"did not end within {MAX_WALL_S:g} s"
        messages = [json.loads(line) for line in notes.read_text().splitlines()] if notes.exists() else []
    exchanges, protocols = read_messages(messages)
    processes = len({one["process"] for one in messages})
    return played(scene, exchanges, prompt=prompt, failure=failure, protocols=protocols, processes=processes)


def read_messages(messages: Iterable[Mapping[str, Any]]) -> tuple[list[Exchange], frozenset[str]]:
    """The tool calls among the messages of a client and a laboratory, and the protocol versions spoken."""
    calls: dict[tuple[int, Any], Mapping[str, Any]] = {}
    exchanges: list[Exchange] = []
    versions: set[str] = set()
    for one in messages:
        message, ident = one["message"], (one["process"], one["message"].get("id"))
        params, result = message.get("params") or {}, message.get("result") or {}
        if one["speaker"] == "client" and message.get("method") == "tools/call":
            calls[ident] = params
            stated = (params.get("_meta") or {}).get("io.modelcontextprotocol/protocolVersion")
            versions |= {stated} if stated else set()
        elif one["speaker"] == "laboratory" and "protocolVersion" in result:
            versions.add(result["protocolVersion"])
        elif one["speaker"] == "laboratory" and ident in calls:
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
    """In what a client's play differs from what was rehearsed; empty if in nothing."""
    pairs = itertools.zip_longest(seen.transcript, expected.transcript)
    for number, (one, other) in enumerate(pairs, start=1):
        if one != other:
            why = f"; {seen.failure}" if one is None and seen.failure else ""
            return f"call {number} is {_short(one)}, not {_short(other)}{why}"
    if seen.grade != expected.grade:
        return f"the grade is {seen.grade}, not {expected.grade}"
    return ""


def _short(one: Mapping[str, Any] | None) -> str:
    return json.dumps(one)[:160] if one else "missing"


def _environment(provider: str, path: str) -> dict[str, str]:
    """What a program finds around it: the model, under the names by which the vendors' clients look for it."""
    kept = {name: os.environ[name] for name in ("HOME", "LANG", "TMPDIR", "SSL_CERT_FILE") if name in os.environ}
    model = {"OPENAI_BASE_URL": f"{provider}/v1", "OPENAI_API_KEY": KEY}
    gemini = {"GOOGLE_GEMINI_BASE_URL": provider, "GOOGLE_API_KEY": KEY}
    return {**kept, **model, **gemini, "PATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
