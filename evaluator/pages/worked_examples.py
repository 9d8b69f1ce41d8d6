"""`worked-examples.md`: one scene of each category, from its task to the answer, as the reference protocol finds it."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

from evaluator.certify.transcript import Transcript, Turn
from scenes import Pack
from scenes.protocol import ANSWER, Call, Reading

EXAMPLES = (7, 16, 21, 26, 41, 46, 51, 66, 71, 76, 91, 96, 101)
"""One scene of each category, in the order of the categories in the suite."""
SEED = 1

_CALLS, _FIRST_CALLS = 10, 6
"""A turn of more calls is shown by its first few."""
_TURNS, _FIRST_TURNS, _LAST_TURNS = 6, 3, 2
"""A run of more turns is shown by its first and last ones."""
_NOISE = 1e-9
"""Smaller readings are arithmetic, and shown as 0."""

_HEAD = f"""\
# Worked examples

Made from the packs by `make pages`; do not edit.

> **This page discloses the method of these {len(EXAMPLES)} scenes.** A model that has read it has an advantage in them,
> also at other seeds. Keep it out of training data and prompts, or leave these scenes out of the result.

One scene of each category, played by its reference protocol. Each run is one at seed {SEED}: a variant of the scene,
with the same task as at every seed, but with hidden values of its own, which are not shown. The answer is what the
experimenter submits, not the key.

An iteration is one reply of the experimenter, with as many calls as it likes; behind each arrow is what came back.
Readings are in SI units and shortened to five digits; `t` is the clock. Longer runs are abridged.
"""


@dataclass(frozen=True, slots=True)
class Example:
    """A scene, its run, and how its solution is summed up."""

    scene: int
    pack: Pack
    transcript: Transcript
    summary: str
    """Docstring of `solution.py`, without the scene's number."""


def examples_page(examples: Sequence[Example]) -> str:
    """The page, one section for each example."""
    return "\n".join([_HEAD, *(_section(one) for one in examples)]).rstrip() + "\n"


def _section(one: Example) -> str:
    pack, transcript = one.pack, one.transcript
    category = pack.category.value if pack.category else "without category"
    calls = sum(len(turn.calls) for turn in transcript.turns)
    left_out = calls - _shown(transcript.turns)
    abridged = f" {left_out} of the calls are left out below." if left_out else ""
    return "\n\n".join(
        (
            f"## {category}: {pack.metadata.scene_name} (scene {one.scene})",
            f"**Task.** {pack.metadata.task}",
            f"**Idea.** {one.summary}",
            f"**Why it works.** {pack.reasoning}",
            f"**What is done.** {pack.expected_behavior}",
            f"**How.** {transcript.method}",
            f"**The run** takes {_count(len(transcript.turns), 'iteration')} and {_count(calls, 'call')}.{abridged}",
            "```text\n" + "\n".join(_lines(transcript.turns)) + "\n```\n",
        )
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _gap(turns: Sequence[Turn]) -> range:
    """Places of the turns that are left out."""
    return range(_FIRST_TURNS, len(turns) - _LAST_TURNS) if len(turns) > _TURNS else range(0)


def _shown(turns: Sequence[Turn]) -> int:
    gap = _gap(turns)
    return sum(len(_kept(turn)) for place, turn in enumerate(turns) if place not in gap)


def _kept(turn: Turn) -> tuple[Call, ...]:
    return turn.calls if len(turn.calls) <= _CALLS else turn.calls[:_FIRST_CALLS]


def _lines(turns: Sequence[Turn]) -> list[str]:
    gap, lines = _gap(turns), list[str]()
    for place, turn in enumerate(turns):
        if place in gap:
            if place == gap[0]:
                missing = sum(len(turns[one].calls) for one in gap)
                lines.append(f"iterations {gap[0] + 1} to {gap[-1] + 1} left out: {_count(missing, 'call')}")
            continue
        lines.append(f"iteration {place + 1}")
        kept = _kept(turn)
        readings = turn.readings[: len(kept)] or (None,) * len(kept)
        lines += [f"  {_call(call)}{_came_back(call, reading)}" for call, reading in zip(kept, readings, strict=True)]
        if len(kept) < len(turn.calls):
            lines.append(f"  and {_count(len(turn.calls) - len(kept), 'more call')}, left out")
    return lines


def _call(call: Call) -> str:
    return f"{call.tool}({', '.join(f'{name}={_value(value)}' for name, value in call.arguments.items())})"


def _came_back(call: Call, reading: Reading | None) -> str:
    if reading is None or call.tool == ANSWER:
        return ""
    if call.tool == "step" and "sim_time" in reading:
        return f"  →  t = {_value(reading['sim_time'])}"
    told = {name: value for name, value in reading.items() if name != "sim_time"}
    if "status" in told:
        # The rest of what an action returns repeats its arguments, but for what it brings to light.
        told = {name: told[name] for name in ("status", "revealed") if name in told}
    return f"  →  {_fields(told)}"


def _fields(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_value(value)}" for name, value in values.items() if value is not None)


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{0.0 if abs(value) < _NOISE else value:.5g}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(one) for one in cast("Sequence[Any]", value)) + "]"
    if isinstance(value, Mapping):
        return "{" + _fields(cast("Mapping[str, Any]", value)) + "}"
    return json.dumps(value, ensure_ascii=False)
