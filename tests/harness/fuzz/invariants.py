"""Invariants that must hold after every call: makes one call and returns the broken invariant, if any."""

import functools
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, cast

import mujoco
import numpy as np
from jsonschema.protocols import Validator
from jsonschema.validators import validator_for

from physment_mcp.errors import EpisodeOver, RefusedCall, quoted
from physment_mcp.session import LabObject, Session
from physment_mcp.tools import TOOLS, calls
from physment_mcp.world.simulation import Snapshot
from scenes.protocol import Call
from tests.harness.fuzz.permitted import overstepped
from tests.harness.fuzz.private import Private

LONGEST_SENTENCE = 1000
"""Largest number of characters of a refusal."""
_INTERNALS = re.compile(
    r"Traceback|0x[0-9a-f]{6}|<\w+[ .]|\.py\b|physment_mcp|pydantic|numpy|np\.|array\(|mujoco|\bmj[A-Z_]|\bMj[A-Z]"
    r"|LabObject|Error\b|Exception|dataclass|\bself\b|site-packages|None\b|\bnan\b|\binf\b",
)
_READS = {tool.name for tool in TOOLS if tool.reads_only}


@dataclass(frozen=True, slots=True)
class Problem:
    """An invariant that a call broke."""

    kind: str
    """Name of the invariant; a shortened sequence must break the same one."""
    detail: str


@dataclass(frozen=True, slots=True)
class Played:
    """The outcome of a call."""

    problem: Problem | None
    refused: bool


def play_call(session: Session, private: Private, call: Call) -> Played:
    """Make a call and check every invariant."""
    saved = session.world.save()  # kept alive: a freed object and a new one could have the same address
    before, counted, objects = fingerprint(session, saved), session.calls, dict(session.state.objects)
    was_over, clock = session.ended, session.world.time
    try:
        with np.errstate(all="ignore"):
            result = calls.call(session, call.tool, call.arguments)
    except RefusedCall as refusal:
        text = str(refusal)
        created = [item.object_id for item in objects.values() if item.created]
        created += [str(call.arguments["name"])] if call.tool == "create_objects" and "name" in call.arguments else []
        problem = _of_refusal(text, call, created, over=was_over, told_over=isinstance(refusal, EpisodeOver))
        unchanged, refused = True, True
    except Exception as crash:  # noqa: BLE001 - the fuzzer looks for any other exception
        return Played(Problem("crash", f"{type(crash).__name__}: {crash}"), refused=True)
    else:
        told = result.model_dump(mode="json", warnings=False)
        text = json.dumps(told, ensure_ascii=False)
        problem = (
            (Problem("end", "a call succeeded after the end") if was_over else None)
            or _of_result(session, call, result.model_dump(warnings=False), told)
            or _of_clock(session, call, clock)
            or _of_permissions(session, call, told, objects)
        )
        unchanged, refused = changes_nothing(call), False
    problem = problem or _of_state(session, before, unchanged=unchanged, refused=refused)
    if problem is None and session.calls != counted + (not was_over):
        problem = Problem("count", f"{session.calls - counted} calls were counted for one")
    if problem is None and (leak := private.leak(session, text, call)):
        problem = Problem("leak", f"{leak!r} stands in {text!r}")
    return Played(problem, refused)


def changes_nothing(call: Call) -> bool:
    """Whether a call only reads."""
    return call.tool in _READS or (call.tool == "detect_collision" and call.arguments.get("elastic_response") is False)


def fingerprint(session: Session, saved: Snapshot | None = None) -> tuple[Any, ...]:
    """Return everything that a refusal must not change: session without counters, world state and model, as bytes."""
    world, state = saved or session.world.save(), session.state
    earlier = world.before_step
    objects = tuple(
        (key, item.name, item.body, item.permissions, item.start.tobytes(), item.known, item.created, item.attached)
        for key, item in state.objects.items()
    )
    given = (repr(state.answer), repr(state.steps), state.answered)
    return (
        *(objects, state.joined, state.simulated_s, state.created_count, state.created_mass, given),
        *(id(world.spec), id(world.model), id(world.data), world.state.tobytes(), model_bytes(world.model)),
        *(world.disturbed, world.revealed, None if earlier is None else (id(earlier.model), earlier.state.tobytes())),
    )


def model_bytes(model: Any) -> bytes:
    """Return the compiled model as bytes."""
    buffer = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, buffer)
    return buffer.tobytes()


def _of_refusal(text: str, call: Call, created: Sequence[str], *, over: bool, told_over: bool) -> Problem | None:
    if over != told_over:
        return Problem("end", f"after the end {over}, told so {told_over}: {text!r}")
    if not text.strip() or "\n" in text or not text.isprintable():
        return Problem("sentence", f"not one printable line: {text!r}")
    if len(text) > LONGEST_SENTENCE:
        return Problem("long sentence", f"{len(text)} characters: {text!r}")
    rest = text
    for value in (call.tool, *call.arguments, *call.arguments.values()):
        if isinstance(value, str | int):
            rest = rest.replace(quoted(str(value)), "").replace(quoted(str(value), 40), "")
    for name in filter(None, created):
        rest = rest.replace(name, "")
    if found := _INTERNALS.search(rest):
        return Problem("internals", f"{found[0]!r} stands in {text!r}")
    return None


def _of_result(session: Session, call: Call, result: dict[str, Any], told: dict[str, Any]) -> Problem | None:
    if not _is_finite(result):
        return Problem("not finite", repr(result)[:500])
    fault = next(_validators()[call.tool].iter_errors(cast("Any", told)), None)
    if fault is not None:
        return Problem("schema", f"{fault.message[:300]} in {told}")
    if told["sim_time"] != session.world.time:
        return Problem("clock", f"told {told['sim_time']} s, is {session.world.time} s")
    return None


def _of_clock(session: Session, call: Call, before: float) -> Problem | None:
    """Check that only `step` advances the time, and by the requested duration."""
    passed, dt = session.world.time - before, session.world.timestep
    asked = max(dt, call.arguments["duration"]) if call.tool == "step" else 0.0
    if abs(passed - asked) > (0.51 * dt if asked else 0.0):
        return Problem("clock", f"{passed} s passed instead of {asked} s")
    return None


def _of_permissions(
    session: Session, call: Call, told: Mapping[str, Any], objects: Mapping[str, LabObject]
) -> Problem | None:
    if call.tool in session.scene.public.disabled_tools:
        return Problem("permission", f"{call.tool} is not available in this scene")
    fault = overstepped(call, told, objects, lambda item: session.world.shape(item.body).type == "sphere")
    return Problem("permission", f"{call.tool} {fault}") if fault else None


def _of_state(session: Session, before: tuple[Any, ...], *, unchanged: bool, refused: bool) -> Problem | None:
    if unchanged and (after := fingerprint(session)) != before:
        parts = [number for number, (old, new) in enumerate(zip(before, after, strict=True)) if old != new]
        what = "a refusal" if refused else "a reading"
        return Problem(f"{what} changed something", f"parts {parts} of the fingerprint")
    if not np.isfinite(session.world.save().state).all():
        return Problem("state", "the state of the world is not finite")
    return None


def _is_finite(value: Any) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(_is_finite(part) for part in value.values())
    return all(_is_finite(part) for part in value) if isinstance(value, list | tuple) else True


@functools.cache
def _validators() -> dict[str, Validator]:
    schemas = {tool.name: tool.output_schema() for tool in TOOLS}
    return {name: validator_for(schema)(schema) for name, schema in schemas.items()}
