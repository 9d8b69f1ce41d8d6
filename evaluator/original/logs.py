"""Reads the published logs: a folder for each episode, with the turns as text. Knows no laboratory and no verdicts.

The turns are UTF-8; the final block was written in a Windows code page. A log without a final block belongs to an
episode that crashed.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from evaluator.errors import UsageError

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
"""What the authors' program writes after a reply that it could not parse."""


@dataclass(frozen=True, slots=True)
class LoggedVerdict:
    """The verdict in a log: answer, key, and whether it was marked right."""

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
    """All logged episodes below a folder, ordered by model, budget, scene and time.

    Raises:
        UsageError: There are none, or one cannot be read.
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
    """Iterations allowed, from the name of the folder, the summary next to the log, or the second prompt."""
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
            # The prompts give one iteration too few: 8 remaining at the second of 10.
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
    """Number of replies that the authors' program parsed, from its history or, after a crash, from its prompts."""
    history = _HISTORY.search(final)
    if history is not None:
        return min(len(_ENTRY.findall(history[1])), len(replies))
    unread = sum(_UNREAD in prompt for prompt in prompts[1:])
    # Without a final block, the last reply crashed the program and was not parsed.
    return max(0, len(replies) - unread - (not finished))
