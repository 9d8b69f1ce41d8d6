"""Certificates 2 and 3: twins cannot be told apart at the start, nor without the modality that the scene is about."""

import math
import random
from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, cast

from evaluator.answers.engine import all_readings, is_intervention, run
from evaluator.certify.driving import drive
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Draw, Subject
from evaluator.records import Episode
from scenes import Category
from scenes.protocol import Call, Reading

RESEEDS = 3
"""How often each knob is drawn anew, on its own."""
RANDOM_SEQUENCES = 20
_EDITS = ("create_objects", "delete_objects", "attach_objects")
_EPSILON = 1e-9
"""Below this, twins differ by the order of sums in the engine alone."""


async def check_twins(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """One opening prompt for all seeds, and the same readings at the start; but different keys."""
    reasons: list[str] = []
    if len({episode.prompt for episode in episodes}) > 1:
        reasons.append("the opening prompt depends on the seed")
    first = await all_readings(subject.session(subject.draw(0)))
    for seed in range(1, len(episodes)):
        told = _difference(first, await all_readings(subject.session(subject.draw(seed))))
        if told:
            reasons.append(f"at the start {told} tells seed {seed} from seed 0")
            break
    if len({str(subject.truth(subject.draw(seed))) for seed in range(len(episodes))}) == 1:
        reasons.append("all seeds have the same key")
    return check("twins", reasons, readings=len(first), seeds=len(episodes))


def modalities(subject: Subject) -> list[str]:
    """The tools that the scene's category is about."""
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
    """With the modality's tool refused, twins in some one knob read the same, whatever else is done to them."""
    tools = modalities(subject)
    reasons: list[str] = []
    figures: dict[str, list[str]] = {}
    if subject.pack.category is Category.CREATE_DELETE_ATTACH and not tools:
        reasons.append(f"a {subject.pack.category.value} scene requires at least one of {', '.join(_EDITS)}")
    for tool in tools:
        if tool not in subject.pack.requires:
            reasons.append(f"{tool} is missing from requires")
        sequences = await _sequences(subject, tool)
        load_bearing: list[str] = []
        told: list[str] = []
        for knob in subject.pack.knobs:
            verdict = await _told_without(subject, tool, knob, sequences)
            if verdict == "":
                load_bearing.append(knob)
            elif verdict is not None:
                told.append(f"{knob} by {verdict}")
        figures[tool] = load_bearing
        if not load_bearing:
            how = "; ".join(told) or "no single knob changes the key"
            reasons.append(f"{tool} is decoration: without it twins are told apart in {how}")
    return check("modality", reasons, **figures)


async def _sequences(subject: Subject, tool: str) -> list[list[Call]]:
    """The reference's interventions without the tool, and random ones."""
    assert subject.solution.solve is not None
    reference = await drive(subject.session(subject.draw(0)), subject.solution.solve)
    own = [call for call in reference.calls if is_intervention(call.tool, call.arguments) and call.tool != tool]
    source = random.Random(f"{subject.files.scene_id}:{tool}")  # noqa: S311 - reproducible, not secret
    known = [one.object_id for one in subject.session(subject.draw(0)).known()]
    return [[*own, _step(1.0)], *(_random_calls(source, known) for _ in range(RANDOM_SEQUENCES))]


def _step(duration: float) -> Call:
    return Call("step", {"duration": duration})


def _random_calls(source: random.Random, known: Sequence[str]) -> list[Call]:
    """Six calls that push, turn, place and make things, with time between them."""
    calls: list[Call] = []
    for _ in range(6):
        vector = [source.uniform(-5, 5) for _ in range(3)]
        target = {"object_id": source.choice(known)} if known else None
        kinds: list[Call] = [
            Call("create_objects", {"name": f"probe{len(calls)}", "pos": vector, "density": 500, "rgba": [1, 0, 0, 1]})
        ]
        if target:
            kinds += [
                Call("apply_force", {**target, "force_vector": vector}),
                Call("apply_torque", {**target, "torque_vector": vector}),
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


async def _told_without(subject: Subject, tool: str, knob: str, sequences: Sequence[Sequence[Call]]) -> str | None:
    """What tells twins in a knob apart without a tool: nothing is "", and None if the knob does not matter."""
    base = subject.draw(0)
    matters = False
    for seed in range(1, RESEEDS + 1):
        twin = subject.twin(knob, seed)
        if subject.agrees(subject.truth(twin), subject.truth(base)):
            continue
        matters = True
        for sequence in sequences:
            told = await _told_apart(subject, (base, twin), tool, sequence)
            if told:
                return told
    return "" if matters else None


async def _told_apart(subject: Subject, twins: tuple[Draw, Draw], tool: str, sequence: Sequence[Call]) -> str:
    one, other = (subject.session(draw) for draw in twins)
    for asked in sequence:
        told = _difference(
            [(asked.tool, await run(one, asked, {tool}))], [(asked.tool, await run(other, asked, {tool}))]
        )
        if told:
            return told
    return _difference(await all_readings(one), await all_readings(other))


def _difference(one: Sequence[tuple[str, Reading]], other: Sequence[tuple[str, Reading]]) -> str:
    """The first call that reads differently; empty if none does."""
    if [call for call, _ in one] != [call for call, _ in other]:
        return "the list of objects"
    return next((call for (call, a), (_, b) in zip(one, other, strict=True) if not same(a, b)), "")


def same(one: Any, other: Any) -> bool:
    """Equal, numbers to the noise of arithmetic."""
    if isinstance(one, dict) and isinstance(other, dict):
        mine, yours = cast("dict[str, Any]", one), cast("dict[str, Any]", other)
        return mine.keys() == yours.keys() and all(same(mine[key], yours[key]) for key in mine)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        pairs = list(zip_longest(cast("Sequence[Any]", one), cast("Sequence[Any]", other)))
        return all(same(a, b) for a, b in pairs)
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=_EPSILON, abs_tol=_EPSILON)
    return bool(one == other)
