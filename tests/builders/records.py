"""Builders of records for tests: keys, calls, exchanges, turns, episodes and grades, with defaults for most fields."""

import json
from typing import Any

from pydantic import JsonValue

from evaluator.records.episode import (
    Episode,
    EpisodeKey,
    Exchange,
    Grade,
    Outcome,
    ToolCall,
    Turn,
    Usage,
    Verdict,
    Versions,
)

STARTED_AT = "2026-01-01T00:00:00+00:00"
VERSIONS = Versions(physment="0", protocol="0", pack="0")


def episode_key(
    scene: int = 7,
    *,
    seed: int = 0,
    agent: str = "x",
    budget: int = 20,
    prompting: str = "zero-shot",
    protocol: str = "native",
    epoch: int = 1,
) -> EpisodeKey:
    """The key of an episode."""
    return EpisodeKey(
        scene=scene, seed=seed, agent=agent, budget=budget, prompting=prompting, protocol=protocol, epoch=epoch
    )


def call(tool: str, /, **arguments: object) -> ToolCall:
    """A tool call with these arguments."""
    return ToolCall(tool=tool, arguments=arguments)


def answer(value: object = 1) -> ToolCall:
    """A call of the tool `answer`."""
    return call("answer", answer=value)


STEP = call("step", duration=0.1)
LOOK = call("get_position", object_id="object_1")
ANSWER = answer()


def returned(tool: str, content: dict[str, Any] | None = None, /, **arguments: object) -> Exchange:
    """Return the exchange of a successful call; the agent read its content as compact JSON."""
    content = content or {}
    text = json.dumps(content, separators=(",", ":"))
    return Exchange(call=call(tool, **arguments), returned=True, content=content, text=text)


def refused(tool: str, text: str = "refused", /, **arguments: object) -> Exchange:
    """Return the exchange of a call that the laboratory refused with an error message."""
    return Exchange(call=call(tool, **arguments), returned=True, is_error=True, text=text)


def rejected(tool: str, /, **arguments: object) -> Exchange:
    """Return the exchange of a call that was not run because it matches no tool schema."""
    return Exchange(call=call(tool, **arguments), returned=False, is_error=True, text="fits no schema")


def skipped(tool: str, /, **arguments: object) -> Exchange:
    """Return the exchange of a call that was not run because an earlier call stopped the batch."""
    return Exchange(call=call(tool, **arguments), returned=False)


def turn(reasoning: str = "", *exchanges: Exchange) -> Turn:
    """A turn of an agent."""
    return Turn(reasoning=reasoning, exchanges=exchanges)


def episode(
    *turns: Turn,
    key: EpisodeKey | None = None,
    outcome: Outcome = Outcome.ANSWERED,
    answer: JsonValue = 1,
    prompt: str = "",
    error: str | None = None,
    usage: Usage | None = None,
    versions: Versions = VERSIONS,
) -> Episode:
    """Return an episode with these turns. `answer` is stored only if the outcome is `answered`."""
    return Episode(
        key=key or episode_key(),
        outcome=outcome,
        answer=answer if outcome is Outcome.ANSWERED else None,
        prompt=prompt,
        turns=turns,
        error=error,
        usage=usage,
        started_at=STARTED_AT,
        duration_s=1.0,
        versions=versions,
    )


def grade(right: bool | None, *, graded: float | None = None, reason: str = "") -> Grade:
    """Return the grade of a right (True), wrong (False) or unscored (None) answer.

    `graded` overrides the score that follows from `right`.
    """
    verdict = Verdict.UNSCORED if right is None else Verdict.CORRECT if right else Verdict.INCORRECT
    share = graded if graded is not None or right is None else float(right)
    return Grade(strict=verdict, graded=share, normalised=verdict, reason=reason)


RIGHT = grade(right=True)
WRONG = grade(right=False)
UNSCORED = grade(right=None)
