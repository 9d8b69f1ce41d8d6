"""Plays the episode that the README shows, and writes it as a transcript of at most 20 lines.

Its scene, two carts on a track, is a pack beside this file and not in the suite, so the README discloses no answer.
"""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pydantic import JsonValue

from evaluator.records.episode import Episode, Exchange, GradeRecord
from evaluator.report.attachments import film_file
from evaluator.report.film_record import Film, read
from evaluator.store.run_folder import RunFolder

PACKS = Path(__file__).parent / "packs"
SCENE, SEED = 905, 3
"""No scene of the suite has this number, so pictures and texts do not show it."""


class Played(NamedTuple):
    """The episode with its grade and its film."""

    episode: Episode
    grade: GradeRecord
    film: Film


class Story(NamedTuple):
    """What the agent did, read, and answered."""

    push_n: float
    """Force on the red cart, along x [N]."""
    push_s: float
    """Time for which it acts [s]."""
    before: float
    """Velocity of the red cart after the push [m/s]."""
    run_s: float
    """Time until the carts are read again [s]."""
    red: float
    """Velocity of the red cart after the collision [m/s]."""
    blue: float
    """Velocity of the blue cart after the collision [m/s]."""
    answer: float
    """The answer [kg]."""
    verdict: str


def played(folder: Path) -> Played:
    """Let the reference agent play the episode, grade it, and make its film.

    Args:
        folder: The run folder to create.
    """
    run = ["run", "--scenes", str(SCENE), "--seeds", str(SEED), "--scenes-dir", str(PACKS), "--out", str(folder)]
    for words in (run, ["film", str(folder), "--scenes-dir", str(PACKS)]):
        subprocess.run([sys.executable, "-m", "evaluator", *words], check=True, capture_output=True)
    stored = RunFolder(folder)
    ((key, record),) = stored.line_hashes().items()
    return Played(
        stored.episodes()[key],
        GradeRecord.model_validate_json((folder / "grades.jsonl").read_text(encoding="utf-8")),
        read(film_file(folder, record).read_bytes(), record),
    )


def story(played: Played) -> Story:
    """Return what the agent did, read, and answered."""
    (push, wait, _, before), (run, red, blue), (answer,) = (turn.exchanges for turn in played.episode.turns)
    forces = push.call.arguments["force_vector"]
    assert isinstance(forces, list)
    pushed, push_s, run_s, answered = map(
        _number,
        (
            forces[0],
            wait.call.arguments["duration"],
            run.call.arguments["duration"],
            answer.call.arguments["answer"],
        ),
    )
    velocities = map(_velocity, (before, red, blue))
    verdict = played.grade.grade.strict.value
    return Story(pushed, push_s, next(velocities), run_s, next(velocities), next(velocities), answered, verdict)


def _velocity(exchange: Exchange) -> float:
    assert exchange.content is not None
    return float(exchange.content["velocity"][0])


def _number(value: JsonValue) -> float:
    assert isinstance(value, int | float)
    return float(value)


def title(episode: Episode) -> str:
    """Return the title of the episode in the README."""
    return f"two carts on a track, seed {episode.key.seed}"


def transcript(played: Played) -> list[str]:
    """The episode, one line for each call; the number at the start of a line is the iteration."""
    episode = played.episode
    calls = sum(len(turn.exchanges) for turn in episode.turns)
    lines = [f"{title(episode)}, at most {episode.key.budget} iterations"]
    for number, turn in enumerate(episode.turns, start=1):
        for place, exchange in enumerate(turn.exchanges):
            call = _call(exchange.call.tool, exchange.call.arguments)
            lines.append(f"{'' if place else number:>2}  {call:<46}{_return_of(exchange)}".rstrip())
    verdict = played.grade.grade.strict.value
    return [*lines, f"graded {verdict} after {len(episode.turns)} iterations and {calls} calls"]


def caption(played: Played) -> str:
    """Describe the film in words, for readers who cannot see it."""
    told = story(played)
    return (
        f"A film of six seconds: a red cart of 1 kg, pushed with {told.push_n:g} N for {told.push_s:g} s, moves at"
        f" {signed(told.before)} m/s and hits a blue cart of unknown mass. Then the red cart moves at"
        f" {signed(told.red)} m/s and the blue one at {signed(told.blue)} m/s. The agent answers"
        f" {told.answer:.2f} kg, which is {told.verdict}."
    )


def signed(value: float) -> str:
    """A velocity in two decimals, with a true minus sign."""
    return f"{value:.2f}".replace("-", "−")


def _call(tool: str, arguments: dict[str, JsonValue]) -> str:
    named = (_value(value) if name == "object_id" else f"{name}={_value(value)}" for name, value in arguments.items())
    return f"{tool}({', '.join(named)})"


def _return_of(exchange: Exchange) -> str:
    match exchange.content:
        case {"velocity": velocity}:
            return f"→ velocity {_value(velocity)}"
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
