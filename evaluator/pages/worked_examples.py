"""Generates `worked-examples.md`: for one scene of each category, the reference protocol from task to answer."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from evaluator.certify.transcript import ReferenceTurn, Transcript
from scenes import Pack
from scenes.protocol import ANSWER, Call, Reading

EXAMPLES = (7, 16, 21, 26, 41, 46, 51, 66, 71, 76, 91, 96, 101)
"""One scene of each category, in the order of the categories."""
SEED = 1

_CALLS, _FIRST_CALLS = 10, 6
"""If a turn has more than 10 calls, only its first 6 are shown."""
_TURNS, _FIRST_TURNS, _LAST_TURNS = 6, 3, 2
"""If a run has more than 6 turns, only its first 3 and last 2 are shown."""
_NOISE = 1e-9
"""Smaller readings are rounding errors and shown as 0."""

_HEAD = f"""\
# Worked examples

Made from the packs by `make pages`; do not edit.

> **This page discloses the method of these {len(EXAMPLES)} scenes.** A model that has read it has an advantage in them,
> also at other seeds. Keep the page out of training data and prompts, or leave these scenes out of the result.

One scene of each category, played by its reference protocol at seed {SEED}. The task is the same for every seed; the
hidden values depend on the seed and are not shown. The answer is the submitted one, not the key.

An iteration is one reply with any number of calls; the result of a call follows the arrow. Readings are in SI units,
rounded to five digits; `t` is the simulated time. Longer runs are abridged.
"""


@dataclass(frozen=True, slots=True)
class Example:
    """A scene, the transcript of its reference protocol, and the summary of its solution."""

    scene: int
    pack: Pack
    transcript: Transcript
    summary: str
    """Docstring of `solution.py`, without the scene's number."""


def examples_page(examples: Sequence[Example]) -> str:
    """The text of the page, with one section for each example."""
    return "\n".join([_HEAD, *map(_section, examples)]).rstrip() + "\n"


def _section(example: Example) -> str:
    pack, transcript = example.pack, example.transcript
    category = pack.category.value if pack.category else "without category"
    calls = sum(len(turn.calls) for turn in transcript.turns)
    left_out = calls - _shown(transcript.turns)
    abridged = f" {left_out} of the calls are left out below." if left_out else ""
    return "\n\n".join(
        (
            f"## {category}: {pack.metadata.scene_name} (scene {example.scene})",
            f"**Task.** {pack.metadata.task}",
            f"**Idea.** {example.summary}",
            f"**Why it works.** {pack.reasoning}",
            f"**What is done.** {pack.expected_behavior}",
            f"**How.** {transcript.method}",
            f"**The run** takes {_count(len(transcript.turns), 'iteration')} and {_count(calls, 'call')}.{abridged}",
            "```text\n" + "\n".join(_lines(transcript.turns)) + "\n```\n",
        )
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _gap(turns: Sequence[ReferenceTurn]) -> range:
    """Indices of the turns that are left out."""
    return range(_FIRST_TURNS, len(turns) - _LAST_TURNS) if len(turns) > _TURNS else range(0)


def _shown(turns: Sequence[ReferenceTurn]) -> int:
    gap = _gap(turns)
    return sum(len(_kept(turn)) for place, turn in enumerate(turns) if place not in gap)


def _kept(turn: ReferenceTurn) -> tuple[Call, ...]:
    return turn.calls if len(turn.calls) <= _CALLS else turn.calls[:_FIRST_CALLS]


def _lines(turns: Sequence[ReferenceTurn]) -> list[str]:
    gap, lines = _gap(turns), list[str]()
    for place, turn in enumerate(turns):
        if place in gap:
            if place == gap[0]:
                missing = sum(len(turns[index].calls) for index in gap)
                lines.append(f"iterations {gap[0] + 1} to {gap[-1] + 1} left out: {_count(missing, 'call')}")
            continue
        lines.append(f"iteration {place + 1}")
        kept = _kept(turn)
        readings = turn.readings[: len(kept)] or (None,) * len(kept)
        lines += [f"  {_call(call)}{_result(call, reading)}" for call, reading in zip(kept, readings, strict=True)]
        if len(kept) < len(turn.calls):
            lines.append(f"  and {_count(len(turn.calls) - len(kept), 'more call')}, left out")
    return lines


def _call(call: Call) -> str:
    return f"{call.tool}({', '.join(f'{name}={_value(value)}' for name, value in call.arguments.items())})"


def _result(call: Call, reading: Reading | None) -> str:
    if reading is None or call.tool == ANSWER:
        return ""
    if call.tool == "step" and "sim_time" in reading:
        return f"  →  t = {_value(reading['sim_time'])}"
    shown = {name: value for name, value in reading.items() if name != "sim_time"}
    if "status" in shown:
        # The other fields in the result of an action repeat its arguments.
        shown = {name: shown[name] for name in ("status", "revealed") if name in shown}
    return f"  →  {_fields(shown)}"


def _fields(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_value(value)}" for name, value in values.items() if value is not None)


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{0.0 if abs(value) < _NOISE else value:.5g}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(part) for part in cast("Sequence[Any]", value)) + "]"
    if isinstance(value, Mapping):
        return "{" + _fields(cast("Mapping[str, Any]", value)) + "}"
    return json.dumps(value, ensure_ascii=False)
