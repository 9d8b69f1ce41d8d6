"""Plays the episode that the README shows, and writes it as a transcript of at most 20 lines.

Its scene, twelve ramps, is a pack beside this file and not one of the suite, so the README discloses nothing.
"""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pydantic import JsonValue

from evaluator.records.episode import Episode, Exchange, GradeRecord

PACKS = Path(__file__).parent / "packs"
SCENE, SEED = 904, 1
"""No scene of the suite has this number, so pictures and texts do not show it."""
RAMPS = 12
SLIDES = 0.01
"""Momentum of 1 kg [kg·m/s] above which the slider counts as sliding; the scene's `solution.py` uses the same value."""


class Measurement(NamedTuple):
    """One iteration: the slider is set down on a ramp, and its momentum is read after a second."""

    ramp: int
    momentum: float
    """Along x, of 1 kg [kg·m/s]."""
    low: int
    """The lowest ramp that may still be the answer, before this measurement."""
    high: int
    """The highest one."""

    @property
    def slides(self) -> bool:
        """Whether the slider began to slide."""
        return self.momentum > SLIDES


def played(folder: Path) -> tuple[Episode, GradeRecord]:
    """Let the reference agent play the episode, and grade it.

    Args:
        folder: The run folder to create.
    """
    run = [sys.executable, "-m", "evaluator", "run", "--scenes", str(SCENE), "--seeds", str(SEED)]
    run += ["--scenes-dir", str(PACKS)]
    subprocess.run([*run, "--out", str(folder)], check=True, capture_output=True)
    return (
        Episode.model_validate_json((folder / "episodes.jsonl").read_text(encoding="utf-8")),
        GradeRecord.model_validate_json((folder / "grades.jsonl").read_text(encoding="utf-8")),
    )


def measurements(episode: Episode) -> list[Measurement]:
    """Return the measurement of each iteration, and the ramps that were possible before it."""
    found: list[Measurement] = []
    low, high = 1, RAMPS
    for turn in episode.turns[:-1]:
        placed, momentum = turn.exchanges[0].call.arguments["y"], _x_of(turn.exchanges[-1])
        assert isinstance(placed, int)
        measured = Measurement(placed, momentum, low, high)
        found.append(measured)
        low, high = (low, measured.ramp) if measured.slides else (measured.ramp + 1, high)
    return found


def _x_of(exchange: Exchange) -> float:
    assert exchange.content is not None
    return float(exchange.content["momentum"]["x"])


def title(episode: Episode) -> str:
    """Return the title of the episode in the README."""
    return f"twelve ramps, seed {episode.key.seed}"


def transcript(episode: Episode, grade: GradeRecord) -> list[str]:
    """The episode, one line for each call; the number at the start of a line is the iteration."""
    calls = sum(len(turn.exchanges) for turn in episode.turns)
    lines = [f"{title(episode)}, at most {episode.key.budget} iterations"]
    for number, turn in enumerate(episode.turns, start=1):
        for place, exchange in enumerate(turn.exchanges):
            call = _call(exchange.call.tool, exchange.call.arguments)
            lines.append(f"{'' if place else number:>2}  {call:<51}{_return_of(exchange)}".rstrip())
    verdict = grade.grade.strict.value
    return [*lines, f"graded {verdict} after {len(episode.turns)} iterations and {calls} calls"]


def caption(episode: Episode, grade: GradeRecord) -> str:
    """Describe the picture of the scene in words, for readers who cannot see it."""
    parts = [
        f"{number}: ramp {done.ramp}, {reading(done.momentum)} kg m/s, {'slides' if done.slides else 'holds'}."
        for number, done in enumerate(measurements(episode), start=1)
    ]
    return (
        f"Twelve ramps, each steeper than the one before, and a red slider on {len(parts)} of them. Iteration"
        f" {' '.join(parts)}"
        f" Answer: {episode.answer}, {grade.grade.strict.value}."
    )


def reading(value: float) -> str:
    """A reading in two digits."""
    return f"{value:.4f}" if abs(value) < SLIDES else f"{value:.2f}"


def _call(tool: str, arguments: dict[str, JsonValue]) -> str:
    named = (_value(value) if name == "object_id" else f"{name}={_value(value)}" for name, value in arguments.items())
    return f"{tool}({', '.join(named)})"


def _return_of(exchange: Exchange) -> str:
    match exchange.content:
        case {"momentum": dict() as momentum}:
            return f"→ momentum {_value(list(momentum.values()))}"
        case {"position": position}:
            return f"→ position {_value(position)}"
        case {"status": status}:
            return f"→ {status}"
        case {"steps": _, "sim_time": time}:
            return f"→ t = {_value(time)}"
        case _:
            return ""


def _value(value: JsonValue) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return f"[{', '.join(map(_value, value))}]"
    return str(value)


def block(lines: Sequence[str]) -> str:
    """Lines as a block of Markdown."""
    return "\n".join(["```text", *lines, "```"])
