"""Reading the published logs: a folder for each episode, with the turns as text. Knows no laboratory and no verdicts.

The turns are UTF-8; the block at the end was written in the code page of a Windows machine. A log without that block is
one of an episode that crashed.
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
"""What their loop says after a reply that it could not read."""


@dataclass(frozen=True, slots=True)
class LoggedVerdict:
    """What a log says of its answer."""

    answer: str
    key: str
    right: bool


@dataclass(frozen=True, slots=True)
class LoggedEpisode:
    """One episode as it was logged."""

    path: Path
    model: str
    budget: int
    """Iterations it was given; 0 where nothing tells."""
    scene: int
    """The scene that the log names."""
    scene_name: str
    """Its title in the opening prompt."""
    replies: tuple[str, ...]
    prompts: tuple[str, ...]
    """What the model read before each reply: the task at first, then the returns of its calls."""
    read: int
    """How many replies their loop could read."""
    finished: bool
    """Whether the log has its final block; if not, their program crashed or was stopped."""
    verdict: LoggedVerdict | None

    @property
    def crashed(self) -> bool:
        """Whether their program ended on a reply."""
        return not self.finished and bool(self.replies)


def find_logs(folder: Path) -> list[LoggedEpisode]:
    """All logged episodes below a folder, by model, budget, scene and time.

    Raises:
        UsageError: There are none, or one cannot be read.
    """
    paths = sorted(folder.rglob("summary_*.txt"))
    if not paths:
        raise UsageError(f"{folder} holds no logs of the published form: …/MODEL/scene_NNN/summary_TIME.txt")
    return sorted(map(_read, paths), key=lambda one: (one.model, one.budget, one.scene, one.path.name))


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
    """Iterations an episode was given: told by its folder, by the summary beside it, or by its second prompt."""
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
            # Their prompts understate what is left by one: 8 at the second of 10.
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
    """Replies that their loop read: told by its history, or in a crashed episode by what it said afterwards."""
    history = _HISTORY.search(final)
    if history is not None:
        return min(len(_ENTRY.findall(history[1])), len(replies))
    unread = sum(_UNREAD in prompt for prompt in prompts[1:])
    # The reply that a program died of was not read; that of one which failed to write its key was.
    return max(0, len(replies) - unread - (not finished))
