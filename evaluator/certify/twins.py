"""Certificates 2 and 3, which compare twins: two variants of one scene with different hidden values.

By certificate 2, prompt and first readings of twins are equal. By certificate 3, twins can be distinguished only with
the tool that the category of their scene requires, such as `create_objects`.
"""

import math
import random
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, cast

from evaluator.answers.engine import all_readings, is_intervention, run
from evaluator.certify.difficulty import drive
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Draw, Subject
from evaluator.records.episode import Episode
from scenes import Category, LabLimits
from scenes.protocol import Call, Reading

RESEEDS = 3
"""Number of twins per knob, each with only this knob redrawn."""
RANDOM_SEQUENCES = 20
"""Number of random call sequences tried on twins."""
_EDITS = ("create_objects", "delete_objects", "attach_objects")
_EPSILON = 1e-9
"""Largest difference that is attributed to floating-point rounding in the engine."""


async def check_twins(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check that all seeds have the same prompt and the same initial readings, but not all the same key."""
    reasons: list[str] = []
    if len({episode.prompt for episode in episodes}) > 1:
        reasons.append("the opening prompt depends on the seed")
    first = await readings_at_start(subject, 0)
    for seed in range(1, len(episodes)):
        found = revealing(first, await readings_at_start(subject, seed), seed)
        if found:
            reasons += found
            break
    if len({str(subject.truth(subject.draw(seed))) for seed in range(len(episodes))}) == 1:
        reasons.append("all seeds have the same key")
    return check("twins", reasons, readings=len(first), seeds=len(episodes))


async def readings_at_start(subject: Subject, seed: int) -> list[tuple[str, Reading]]:
    """All readings in the initial state of a variant, each with its call."""
    return await all_readings(subject.session_to_compare(subject.draw(seed)))


def revealing(first: Sequence[tuple[str, Reading]], other: Sequence[tuple[str, Reading]], seed: int) -> list[str]:
    """Return a reason for failure if the initial readings of a seed differ from those of seed 0; otherwise none."""
    call = _difference(first, other)
    return [f"at the start {call} distinguishes seed {seed} from seed 0"] if call else []


def modalities(subject: Subject) -> list[str]:
    """The tools that the scene's category requires."""
    category = subject.pack.category
    if category is None:
        return []
    if category.value.endswith("creation"):
        return ["create_objects"]
    if category.value.endswith("hidden"):
        return ["find_objects"]
    edits = [tool for tool in _EDITS if tool in subject.pack.requires]
    return edits if category is Category.CREATE_DELETE_ATTACH else []


async def check_modality(subject: Subject) -> Check:
    """Check that the category's tool is needed: without it, at least one knob has no effect on the readings."""
    tools = modalities(subject)
    reasons: list[str] = []
    figures: dict[str, list[str]] = {}
    if subject.pack.category is Category.CREATE_DELETE_ATTACH and not tools:
        reasons.append(f"a {subject.pack.category.value} scene requires at least one of {', '.join(_EDITS)}")
    for tool in tools:
        if tool not in subject.pack.requires:
            reasons.append(f"{tool} is missing from requires")
        sequences = await _sequences(subject, tool)
        needing: list[str] = []
        revealed: list[str] = []
        for knob in subject.pack.knobs:
            revealing = await _revealing_without(subject, tool, knob, sequences)
            if revealing == "":
                needing.append(knob)
            elif revealing is not None:
                revealed.append(f"{knob} by {revealing}")
        figures[tool] = needing
        if not needing:
            how = "; ".join(revealed) or "no single knob changes the key"
            reasons.append(f"{tool} is not needed: without it twins can be distinguished: {how}")
    return check("modality", reasons, **figures)


async def _sequences(subject: Subject, tool: str) -> list[list[Call]]:
    """Return sequences of calls: the reference's interventions without the category's tool, and random ones."""
    assert subject.solution.solve is not None
    reference = await drive(subject.session(subject.draw(0)), subject.solution.solve)
    own = [call for call in reference.calls if is_intervention(call.tool, call.arguments) and call.tool != tool]
    source = random.Random(f"{subject.files.scene_id}:{tool}")  # noqa: S311 - reproducible, not secret
    known = [listed.object_id for listed in subject.session(subject.draw(0)).known()]
    limits = subject.pack.limits or LabLimits()
    return [[*own, _step(1.0)], *(_random_calls(source, known, limits) for _ in range(RANDOM_SEQUENCES))]


def _step(duration: float) -> Call:
    return Call("step", {"duration": duration})


def _random_calls(source: random.Random, known: Sequence[str], limits: LabLimits) -> list[Call]:
    """Return six random calls that push, turn, place, create or delete objects, with a step after each."""
    calls: list[Call] = []
    for _ in range(6):
        vector = [source.uniform(-5, 5) for _ in range(3)]
        target = {"object_id": source.choice(known)} if known else None
        kinds: list[Call] = [
            Call("create_objects", {"name": f"probe{len(calls)}", "pos": vector, "density": 500, "rgba": [1, 0, 0, 1]})
        ]
        if target:
            kinds += [
                Call("apply_force", {**target, "force_vector": _within(vector, limits.force)}),
                Call("apply_torque", {**target, "torque_vector": _within(vector, limits.torque)}),
                Call("set_velocity", {**target, "velocity_vector": vector}),
                Call(
                    "change_position",
                    {**target, **dict(zip(("dx", "dy", "dz"), (v / 20 for v in vector), strict=True))},
                ),
                Call("find_objects", {}),
                Call("delete_objects", target),
            ]
        calls += [source.choice(kinds), _step(source.uniform(0.02, 0.8))]
    return calls


def _within(vector: Sequence[float], limit: float | None) -> list[float]:
    """Scale a vector down to a maximal length; None means no limit."""
    size = math.hypot(*vector)
    scale = 1.0 if limit is None or size <= limit else limit / size
    return [scale * part for part in vector]


async def _revealing_without(subject: Subject, tool: str, knob: str, sequences: Sequence[Sequence[Call]]) -> str | None:
    """Return the first call that distinguishes two variants that differ in one knob, without using the tool.

    Returns:
        The call; "" if none does; None if the twins have the same key.
    """
    base = subject.draw(0)
    matters = False
    for seed in range(1, RESEEDS + 1):
        twin = subject.twin(knob, seed)
        if subject.agrees(subject.truth(twin), subject.truth(base)):
            continue
        matters = True
        for sequence in sequences:
            revealing = await _revealing(subject, (base, twin), tool, sequence)
            if revealing:
                return revealing
    return "" if matters else None


async def _revealing(subject: Subject, twins: tuple[Draw, Draw], tool: str, sequence: Sequence[Call]) -> str:
    """Return the first call of a sequence, or reading after it, that distinguishes twins; empty if none does."""
    first, second = (subject.session_to_compare(draw) for draw in twins)
    for asked in sequence:
        revealing = _difference(
            [(asked.tool, await run(first, asked, {tool}))], [(asked.tool, await run(second, asked, {tool}))]
        )
        if revealing:
            return revealing
    return _difference(await all_readings(first), await all_readings(second))


def _difference(first: Sequence[tuple[str, Reading]], second: Sequence[tuple[str, Reading]]) -> str:
    """Return the first call whose results differ between two sets of readings; empty if they are equal."""
    if [call for call, _ in first] != [call for call, _ in second]:
        return "the list of objects"
    return next((call for (call, a), (_, b) in zip(first, second, strict=True) if not same(a, b)), "")


def same(a: Any, b: Any) -> bool:
    """Return whether two results are equal, except for rounding of numbers."""
    if isinstance(a, dict) and isinstance(b, dict):
        first, second = cast("dict[str, Any]", a), cast("dict[str, Any]", b)
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(a, list | tuple) and isinstance(b, list | tuple):
        pairs = zip_longest(cast("Sequence[Any]", a), cast("Sequence[Any]", b))
        return all(same(left, right) for left, right in pairs)
    if isinstance(a, float) and isinstance(b, float):
        return math.isclose(a, b, rel_tol=_EPSILON, abs_tol=_EPSILON)
    return bool(a == b)
