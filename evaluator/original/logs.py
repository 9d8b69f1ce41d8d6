"""Parses the published logs, and converts them to episode records. Independent of servers and verdicts.

The turns are encoded in UTF-8, but the final block in a Windows code page. A log without a final block belongs to an
episode that crashed.

Replaying a log gives results of this project's server, which the model never saw. Only the results in the log can show
whether a number in a reply was read or invented.
"""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import JsonValue

from evaluator.episode.player import ANSWER
from evaluator.episode.protocols.text import parse_reply
from evaluator.errors import UsageError
from evaluator.records.episode import UNREAD, Episode, EpisodeKey, Exchange, Outcome, ToolCall, Turn, Versions

_END = b"=== Final Experiment Summary ==="
_TITLE = re.compile(r"=== Experiment Log for (\d+) ===")
_TURN = re.compile(r"^--- Iteration \d+ ---\r?\nLLM Input Prompt Below:\r?\n", re.MULTILINE)
_REPLY = re.compile(r"^LLM Response Below:[ \t]*\r?\n?", re.MULTILINE)
_NAME = re.compile(r"^Scene Description: (.*?)\.?\r?$", re.MULTILINE)
_VERDICT = re.compile(
    r"^LLM's Final Answer: (?P<answer>.*?)\r?\nCorrect Answer: (?P<key>.*?)\r?\nIs Correct: (?P<right>True|False)\s",
    re.MULTILINE | re.DOTALL,
)
_HISTORY = re.compile(r"--- Tool Call History ---(.*?)(?:^---|\Z)", re.MULTILINE | re.DOTALL)
_ENTRY = re.compile(r"^  \[\d+\] ", re.MULTILINE)
_UNREAD = "Invalid JSON syntax"
"""Message of the authors' program after a reply that it could not parse."""


@dataclass(frozen=True, slots=True)
class LoggedVerdict:
    """The verdict in a log: the answer, the answer key, and whether the answer was marked right."""

    answer: str
    key: str
    right: bool


@dataclass(frozen=True, slots=True)
class LoggedEpisode:
    """One episode as logged by the authors' program."""

    path: Path
    model: str
    budget: int
    """Number of iterations allowed; 0 if unknown."""
    scene: int
    """The scene number in the log."""
    scene_name: str
    """The scene's title in the opening prompt."""
    replies: tuple[str, ...]
    prompts: tuple[str, ...]
    """The prompt before each reply: first the task, then the results of the calls."""
    read: int
    """Number of replies that the authors' program could parse."""
    finished: bool
    """Whether the log has a final block; if not, the authors' program crashed or was stopped."""
    verdict: LoggedVerdict | None

    @property
    def crashed(self) -> bool:
        """Whether the authors' program crashed after a reply."""
        return not self.finished and bool(self.replies)


def find_logs(folder: Path) -> list[LoggedEpisode]:
    """Parse all logs below a folder, ordered by model, budget, scene and time.

    Raises:
        UsageError: There is no log, or one cannot be read.
    """
    paths = sorted(folder.rglob("summary_*.txt"))
    if not paths:
        raise UsageError(f"{folder} holds no logs of the published form: …/MODEL/scene_NNN/summary_TIME.txt")
    return sorted(map(_read, paths), key=lambda log: (log.model, log.budget, log.scene, log.path.name))


def _read(path: Path) -> LoggedEpisode:
    try:
        head, sign, tail = path.read_bytes().partition(_END)
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    text = head.decode("utf-8", "replace")
    title = _TITLE.search(text)
    number = title or re.search(r"(\d+)$", path.parent.name)
    if number is None:
        raise UsageError(f"{path}: neither the log nor its folder names a scene")
    parts = [_REPLY.split(part, maxsplit=1) for part in _TURN.split(text)[1:]]
    prompts = [part[0] for part in parts]
    replies = tuple(part[1].strip() for part in parts if len(part) == 2)
    name = _NAME.search(text)
    final = _decoded(tail)
    return LoggedEpisode(
        path=path,
        model=path.parent.parent.name,
        budget=_budget(path, prompts),
        scene=int(number[1]),
        scene_name=name[1] if name else "",
        replies=replies,
        prompts=tuple(prompts),
        read=_read_by_them(prompts, replies, final, finished=bool(sign)),
        finished=bool(sign),
        verdict=_verdict(final),
    )


def _budget(path: Path, prompts: list[str]) -> int:
    """Determine the allowed iterations from the folder's name, the summary next to the log, or a later prompt."""
    folder = re.search(r"iterations_(\d+)", path.parent.as_posix())
    if folder is not None:
        return int(folder[1])
    beside = path.with_name(f"log_{path.stem.removeprefix('summary_')}.json")
    if beside.is_file():
        given = re.search(r'"Iterations Given":\s*(\d+)', beside.read_text(encoding="utf-8", errors="replace"))
        if given is not None:
            return int(given[1])
    for number, prompt in enumerate(prompts, start=1):
        left = re.search(r"You have (\d+) iterations remaining", prompt)
        if left is not None:
            # The prompts state one iteration too few: 8 remaining at the second of 10.
            return int(left[1]) + number
    return 0


def _decoded(tail: bytes) -> str:
    try:
        return tail.decode("utf-8")
    except UnicodeDecodeError:
        return tail.decode("cp1252", "replace")


def _verdict(final: str) -> LoggedVerdict | None:
    match = _VERDICT.search(final)
    if match is None:
        return None
    return LoggedVerdict(match["answer"].strip(), match["key"].strip(), match["right"] == "True")


def _read_by_them(prompts: list[str], replies: tuple[str, ...], final: str, *, finished: bool) -> int:
    """Count the replies that the authors' program parsed, from its history or, after a crash, from its prompts."""
    history = _HISTORY.search(final)
    if history is not None:
        return min(len(_ENTRY.findall(history[1])), len(replies))
    unread = sum(_UNREAD in prompt for prompt in prompts[1:])
    # Without a final block, the last reply crashed the program and was not parsed.
    return max(0, len(replies) - unread - (not finished))


_RETURN = re.compile(r"^([A-Za-z_]\w*)\((.*?)\) -> (.*)$", re.MULTILINE)
_TIME = re.compile(r"^\[sim_time=([0-9.eE+-]+)\]", re.MULTILINE)
_ERROR = "ERROR: "


def as_logged(log: LoggedEpisode, key: EpisodeKey, versions: Versions) -> Episode:
    """Convert a log to an episode record.

    The result of a call is the next line of the following prompt that names its tool. A call without such a line did
    not run, which includes all calls of a reply that the authors' program could not parse. A reply with several sets of
    calls, of which that program ran the first, has no calls here. Calls before the answer in the last batch ran, but
    the model did not see their results. The log gives the simulated time once after each batch; here it is added to the
    result of the batch's last successful call.

    Args:
        log: The log, with at least one reply.
        key: The key under which the episode is stored.
        versions: Versions to record; the pack's version is that of the pack used for grading.
    """
    last = len(log.replies) - 1
    turns = [_turn(reply, _next_prompt(log, index), is_last=index == last) for index, reply in enumerate(log.replies)]
    calls = [exchange.call for exchange in turns[-1].exchanges]
    answers = [call.arguments.get("answer") for call in calls if call.tool == ANSWER]
    answered = bool(answers) and answers[-1] is not None
    used_up = len(turns) >= key.budget
    return Episode(
        key=key,
        outcome=Outcome.ANSWERED if answered else Outcome.BUDGET_EXHAUSTED if used_up else Outcome.AGENT_ERROR,
        answer=answers[-1] if answered else None,
        prompt=log.prompts[0],
        turns=tuple(turns),
        error=None if answered or used_up else "the log ends here",
        started_at="",
        duration_s=0,
        versions=versions,
    )


def _next_prompt(log: LoggedEpisode, index: int) -> str:
    return log.prompts[index + 1] if index + 1 < len(log.prompts) else ""


def _turn(text: str, results: str, *, is_last: bool) -> Turn:
    reply = parse_reply(text)
    lines = _RETURN.findall(results)
    exchanges: list[Exchange] = []
    for call in reply.calls:
        if call.tool == ANSWER:
            # If the authors' program continued after an answer, it had not accepted the answer.
            exchanges.append(Exchange(call=call, returned=is_last))
        elif lines and lines[0][0] == call.tool:
            exchanges.append(_exchange(call, lines.pop(0)[2]))
        else:
            answers = any(other.tool == ANSWER for other in reply.calls)
            exchanges.append(Exchange(call=call, returned=is_last and answers))
    time = _TIME.search(results)
    note = f"{UNREAD}: {reply.malformed}" if reply.malformed else "" if exchanges else "no call"
    return Turn(reasoning=reply.reasoning, exchanges=_timed(exchanges, time and time[1]), note=note)


def _exchange(call: ToolCall, result: str) -> Exchange:
    if result.startswith(_ERROR):
        return Exchange(call=call, returned=True, is_error=True, text=result.removeprefix(_ERROR))
    return Exchange(call=call, returned=True, content=_content(result), text=result)


def _content(result: str) -> dict[str, Any]:
    """Parse a result as a JSON object; any other value, such as `ok` or a list, is put under the key `result`."""
    try:
        value: JsonValue = json.loads(result, parse_constant=lambda _: None)
    except ValueError:
        value = result
    return value if isinstance(value, dict) else {"result": value}


def _timed(exchanges: Sequence[Exchange], time: str | None) -> tuple[Exchange, ...]:
    """Add the simulated time [s] to the last successful exchange of a batch."""
    last = next((i for i in reversed(range(len(exchanges))) if exchanges[i].content is not None), None)
    if time is None or last is None:
        return tuple(exchanges)
    content = {**(exchanges[last].content or {}), "sim_time": float(time)}
    return (*exchanges[:last], exchanges[last].model_copy(update={"content": content}), *exchanges[last + 1 :])
