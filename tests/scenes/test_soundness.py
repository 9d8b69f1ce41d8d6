"""What makes a scene sound, proven for every pack there is: its key, its twins, its chance, its difficulty."""

import math
from collections.abc import Iterator
from typing import Any, cast

import pytest
from pydantic import JsonValue

from evaluator.certify.engine import drawn_world
from evaluator.grading import AnswerKey, grade
from evaluator.records import Verdict
from physment_mcp.calls import call
from physment_mcp.errors import RefusedCall
from physment_mcp.prompts import PromptOptions, opening_prompt
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from scenes import (
    CANARY,
    Category,
    KnobValue,
    Pack,
    PackFiles,
    draw_knobs,
    drawn_mjcf,
    find_pack,
    list_packs,
    read_pack,
)
from scenes.protocol import AnswerValue, load_solution

SCENES = [files.scene_id for files in list_packs()]
SEEDS = range(4)
MODALITY = {"creation": "create_objects", "hidden": "find_objects"}
READS_ONLY = {tool.name for tool in TOOLS if tool.reads_only} | {"answer"}


def opened(scene: int, seed: int) -> tuple[PackFiles, Pack, dict[str, KnobValue]]:
    files = find_pack(scene)
    pack = read_pack(files)
    return files, pack, draw_knobs(files, pack, seed)


def true_value(scene: int, seed: int) -> AnswerValue:
    files, _, knobs = opened(scene, seed)
    solution = load_solution(files)
    if solution.theory is not None:
        return solution.theory(knobs)
    return measured(scene, seed)


def measured(scene: int, seed: int, timestep: float | None = None) -> AnswerValue:
    files, pack, knobs = opened(scene, seed)
    solution = load_solution(files)
    assert solution.measure is not None, f"scene {scene} has no measure"
    return solution.measure(drawn_world(drawn_mjcf(files, pack, knobs, canonical=seed == 0), timestep), knobs)


def agrees(value: AnswerValue, key: AnswerValue, pack: Pack, share: float) -> bool:
    """Whether two values agree to a share of the pack's tolerance; words must be the same."""
    spec = pack.answer_spec
    assert spec is not None
    pairs = zip(*(one if isinstance(one, list) else [one] for one in (value, key)), strict=True)
    return all(
        str(one) == str(other)
        if isinstance(one, str) or isinstance(other, str)
        else abs(one - other) <= share * (spec.abs_tol + spec.rel_tol * abs(other))
        for one, other in pairs
    )


async def readings(session: Session) -> list[Any]:
    """Everything the reading tools say of everything known now."""
    said: list[Any] = []
    for name, arguments in _all_reads(session):
        try:
            said.append((await call(session, name, arguments)).model_dump())
        except RefusedCall as refusal:
            said.append(str(refusal))
    return said


def _all_reads(session: Session) -> Iterator[tuple[str, dict[str, Any]]]:
    known = [one.object_id for one in session.known()]
    for tool in TOOLS:
        fields = set(tool.arguments.model_fields)
        if tool.reads_only and "object_id" in fields:
            for object_id in known:
                yield tool.name, {"object_id": object_id} | ({"mass": 1.0} if "mass" in fields else {})
        elif tool.name == "get_center_of_mass":
            yield tool.name, {}
    for first in known:
        for second in known:
            yield "detect_collision", {"obj1_id": first, "obj2_id": second, "elastic_response": False}


def same(one: Any, other: Any) -> bool:
    """Equal, numbers to 1e-9: below that twins differ by the order of sums in the engine alone."""
    if isinstance(one, dict):
        return isinstance(other, dict) and one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-9)
    return one == other


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("seed", SEEDS)
def test_theory_and_engine_agree_to_a_quarter_of_the_tolerance(scene: int, seed: int) -> None:
    _, pack, _ = opened(scene, seed)
    assert agrees(measured(scene, seed), true_value(scene, seed), pack, 0.25)


@pytest.mark.parametrize("scene", SCENES)
def test_half_the_time_step_changes_the_engines_value_by_less_than_a_quarter_of_the_tolerance(scene: int) -> None:
    _, pack, _ = opened(scene, 1)
    assert agrees(measured(scene, 1, 0.0025), measured(scene, 1), pack, 0.25)


@pytest.mark.parametrize("scene", SCENES)
async def test_twins_have_one_prompt_and_one_set_of_readings_but_other_keys(scene: int) -> None:
    sessions = [Session(load_scene(scene, seed)) for seed in range(6)]
    prompts = {opening_prompt(session, PromptOptions(budget=20)) for session in sessions}
    assert len(prompts) == 1
    first, *others = [await readings(session) for session in sessions]
    for other in others:
        assert same(first, other)
    assert len({str(true_value(scene, seed)) for seed in range(6)}) > 1


@pytest.mark.parametrize("scene", SCENES)
async def test_the_reference_protocol_is_as_long_as_its_category_says(scene: int) -> None:
    files, pack, _ = opened(scene, 0)
    assert pack.category is not None
    solve = load_solution(files).solve
    assert solve is not None
    session, interventions, turns, used = Session(load_scene(scene, 1)), 0, 0, set[str]()
    protocol = solve(opening_prompt(session))
    batch = next(protocol)
    while not session.over:
        turns += 1
        said: list[dict[str, Any]] = []
        for one in batch:
            used.add(one.tool)
            looks = one.tool == "detect_collision" and one.arguments.get("elastic_response") is False
            interventions += one.tool not in READS_ONLY and not looks
            said.append((await call(session, one.tool, one.arguments)).model_dump())
        if not session.over:
            batch = protocol.send(said)
    if pack.category.startswith("easy"):
        assert interventions <= 3
        assert turns <= 5
    elif pack.category.startswith("hard"):
        assert interventions > 3
        assert turns <= 20
    assert (len(pack.concepts) >= 2) == ("multi" in pack.category or pack.category is Category.CREATE_DELETE_ATTACH)
    assert set(pack.requires) <= used
    needed = next((tool for word, tool in MODALITY.items() if pack.category.endswith(word)), None)
    assert needed is None or needed in pack.requires


@pytest.mark.parametrize("scene", SCENES)
def test_no_constant_answer_is_right_often(scene: int) -> None:
    files, pack, _ = opened(scene, 0)
    theory = load_solution(files).theory
    # Without a closed form fewer draws must do: each needs the engine.
    seeds = range(1, 201) if theory else range(1, 31)
    values = [true_value(scene, seed) for seed in seeds]
    spec = pack.answer_spec
    assert spec is not None
    keys = [AnswerKey(tuple(one) if isinstance(one, list) else one, spec, {}) for one in values]
    guesses = [list(one) if isinstance(one, list) else one for one in values[:30]]
    best = max(sum(grade(cast("JsonValue", guess), key).strict is Verdict.CORRECT for key in keys) for guess in guesses)
    # A choice may be guessed; a number may not.
    allowed = 1 / len(spec.options) + 0.10 if spec.options else 0.20
    assert best / len(keys) <= allowed


@pytest.mark.parametrize("scene", SCENES)
def test_a_pack_carries_the_canary_and_neutral_names(scene: int) -> None:
    _, pack, _ = opened(scene, 0)
    assert pack.canary == CANARY
    telling = {"hollow", "solid", "heavy", "light", "rough", "smooth", "elastic", "hidden", "long", "short"}
    assert not [one.name for one in pack.objects.values() if telling & set(one.name.replace("_", " ").split())]


def test_each_category_has_a_scene() -> None:
    assert {read_pack(find_pack(scene)).category for scene in SCENES} == set(Category)
