"""Tests that each certificate detects a planted fault, and that the stored certificates match the suite's packs."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import pytest
from pydantic import JsonValue

from evaluator.answers.grading import grade_steps
from evaluator.certify.difficulty import drive
from evaluator.certify.keys import check_key
from evaluator.certify.lint import lint
from evaluator.certify.records import CERTIFICATES, Check, SceneCertificate, certificates_of, read_certificates
from evaluator.certify.subject import Subject
from evaluator.certify.twins import check_twins, same
from evaluator.certify.verify import BUDGET, certify, check_sane, play_reference
from evaluator.episode.connect import EpisodeConnector
from physment_mcp.serving.prompts import PromptOptions, opening_prompt
from scenes import Category, PackFiles, default_folder, find_pack, list_packs, pack_hash, read_pack
from scenes.draw import step_values
from scenes.pack import Rung
from tests.builders.author import Author
from tests.builders.records import episode, episode_key, returned, turn

SCENES = [files.scene_id for files in list_packs()]
EASY_CATEGORIES = {category for category in Category if category.rung is Rung.EASY}
EASY = [files.scene_id for files in list_packs() if read_pack(files).category in EASY_CATEGORIES]
PLAYED = [*EASY[::2], *[scene for scene in SCENES if scene not in EASY and scene < 200][::13]]
"""Scenes that the reference plays in `make test`: every other easy one, and every 13th of the others of the suite."""
SEEDS = 4


async def proven(files: PackFiles, laboratory: Callable[[Path], EpisodeConnector]) -> SceneCertificate:
    return await certify(files, SEEDS, laboratory(files.folder.parent))


def failed(certificate: SceneCertificate) -> dict[str, Check]:
    return {check.name: check for check in certificate.checks if not check.passed}


@pytest.mark.parametrize("category", [Category.EASY_SINGLE, Category.EASY_SINGLE_CREATION, Category.EASY_SINGLE_HIDDEN])
async def test_a_scene_made_from_the_template_is_sound(
    category: Category, author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    certificate = await proven(author.write(category), laboratory)
    assert not failed(certificate)
    assert tuple(check.name for check in certificate.checks) == CERTIFICATES


async def test_a_wrong_theory_fails_the_key(author: Author, laboratory: Callable[[Path], EpisodeConnector]) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.replace(files.solution, 'return knobs["m"]', 'return 1.1 * knobs["m"]')
    assert "theory gives" in " ".join(failed(await proven(files, laboratory))["key"].reasons)


async def test_an_inaccurate_reference_fails_the_key(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.replace(files.solution, "yield [answer(FORCE_N", "yield [answer(1.04 * FORCE_N")
    (reason,) = {
        sentence.split(":")[1].split()[1] for sentence in failed(await proven(files, laboratory))["key"].reasons
    }
    assert reason == "reference"


async def test_a_wrong_stored_answer_fails_the_key(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack.update(answer=2.1))
    assert "the stored answer is 2.1" in failed(await proven(files, laboratory))["key"].reasons[0]


async def test_a_result_that_depends_on_the_time_step_fails_the_key(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.replace(files.solution, "engine.step(engine.whole_steps(PUSH_S))", "engine.step(round(PUSH_S / 0.005))")
    assert "half the time step" in " ".join(failed(await proven(files, laboratory))["key"].reasons)


async def test_a_tool_that_reveals_a_hidden_value_at_the_start_fails_the_twins(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack["apply"].update({"geom[object_1_geom].size": ["m / 10", "0.1", "0.1"]}))
    reasons = failed(await proven(files, laboratory))["twins"].reasons
    assert any("get_parameters(object_1)" in reason for reason in reasons), reasons


async def test_a_scene_without_hidden_values_fails_the_twins(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack["knobs"]["m"].update({"log_uniform": None, "choice": [2.0]}))
    found = failed(await proven(files, laboratory))
    assert found["twins"].reasons == ("all seeds have the same key",)
    assert "one constant answer is right on 100%" in found["constant"].reasons[0]


async def test_a_constant_answer_that_is_often_right_fails_the_constant(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack["knobs"]["m"].update(log_uniform=[1.8, 2.2]))
    assert set(failed(await proven(files, laboratory))) == {"constant"}


async def test_a_creation_scene_that_can_be_solved_without_creating_fails_the_modality(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE_CREATION)
    # The pan may now be pushed, so the stiffness of its spring can be measured without a ball.
    author.edit(files, lambda pack: pack["object_permissions"]["object_1_permissions"].update(actuate=True))
    found = failed(await proven(files, laboratory))
    assert set(found) == {"modality"}
    assert "create_objects is not needed" in found["modality"].reasons[0]


async def test_a_hidden_body_that_can_be_measured_without_finding_it_fails_the_modality(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE_HIDDEN)
    # The post is now coupled to the hidden body, so a push on the post measures the hidden mass.
    author.replace(
        files.mjcf,
        '<body name="object_1" pos="0 2 0.5">',
        '<body name="object_1" pos="0 2 0.5"><joint name="j" type="slide" axis="1 0 0"/>',
    )
    author.replace(
        files.mjcf, "</worldbody>", '</worldbody><equality><joint joint1="object_2_joint" joint2="j"/></equality>'
    )
    assert "find_objects is not needed" in failed(await proven(files, laboratory))["modality"].reasons[0]


async def test_a_hard_scene_solved_by_fixed_interventions_fails_the_difficulty(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack.update(category="hard-single"))
    author.replace(
        files.solution,
        'call("step", duration=PUSH_S),',
        'call("step", duration=PUSH_S / 4), ' + 'call("step", duration=PUSH_S / 4), ' * 3,
    )
    (reason,) = failed(await proven(files, laboratory))["difficulty"].reasons
    assert "wrong on only 0 of 3" in reason


async def test_a_hard_scene_with_an_easy_protocol_fails_the_difficulty(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack.update(category="hard-single"))
    found = failed(await proven(files, laboratory))
    assert "needs only 2 interventions" in found["difficulty"].reasons[0]


async def test_a_multi_scene_with_a_single_concept_fails_the_difficulty(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack.update(category="easy-multi"))
    found = failed(await proven(files, laboratory))
    assert "two or more concepts" in found["difficulty"].reasons[0]


async def test_friction_on_only_one_of_two_touching_geoms_is_not_sane(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.replace(
        files.mjcf,
        "<worldbody>",
        '<worldbody><geom name="floor" type="plane" size="9 9 0.1" pos="0 0 0.9" friction="0.1 0 0"/>',
    )
    found = failed(await proven(files, laboratory))
    assert "the friction of floor is not what acts between floor and object_1_geom" in found["sane"].reasons[0]


async def test_a_deep_contact_at_the_start_is_not_sane(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.replace(files.mjcf, "<worldbody>", '<worldbody><geom size="0.1" pos="-0.25 0 1"/>')
    assert "a contact is 50 mm deep at the start" in failed(await proven(files, laboratory))["sane"].reasons[0]


async def test_a_scene_that_gains_energy_is_not_sane(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    # Negative damping adds energy to a swing.
    swing = (
        '<body name="extra" pos="5 5 1"><joint type="hinge" axis="0 1 0" damping="-0.2"/>'
        '<geom name="bob" size="0.1" pos="0.5 0 -0.5" mass="1" contype="0" conaffinity="0"/></body>'
    )
    author.replace(files.mjcf, "<worldbody>", f"<worldbody>{swing}")
    (reason,) = failed(await proven(files, laboratory))["sane"].reasons
    assert "gains mechanical energy" in reason


async def test_an_exception_in_solution_py_is_reported_as_a_reason(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.replace(files.solution, 'return knobs["m"]', 'return knobs["mass"]')
    assert "solution.py failed: KeyError('mass')" in failed(await proven(files, laboratory))["key"].reasons[0]


async def test_a_pack_that_cannot_be_read_fails_every_certificate(
    author: Author, laboratory: Callable[[Path], EpisodeConnector]
) -> None:
    files = author.write(Category.EASY_SINGLE)
    files.solution.unlink()
    found = failed(await proven(files, laboratory))
    assert set(found) == set(CERTIFICATES)
    assert "no such file" in found["key"].reasons[0]


def _part(kind: str, *points: object) -> list[dict[str, object]]:
    return [{"kind": kind, "points": points}]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda pack: pack.update(knob={}), "unknown field knob; did you mean knobs?"),
        (lambda pack: pack["metadata"].update(author="x"), "unknown field metadata.author; nothing reads it"),
        (lambda pack: pack["knobs"]["m"].update(unit="kg"), "unknown field knobs.m.unit"),
        (lambda pack: pack.update(canary=None), "canary must be"),
        (lambda pack: pack.update(number_of_objects=2), "number_of_objects is 2, but 1 objects are listed"),
        (lambda pack: pack.update(reasoning=""), "reasoning is missing or empty"),
        (lambda pack: pack["answer_spec"].update(unit=None), "answer_spec.unit is missing"),
        (lambda pack: pack["answer_spec"].update(kind="choice"), "answer_spec.options is empty"),
        (lambda pack: pack["answer_spec"].update(kind="choice", options=["1"]), "is not among the options"),
        (lambda pack: pack["objects"]["object_1"].update(name="heavy cart"), "reveals a property: heavy"),
        (lambda pack: pack["objects"]["object_1"].update(object_id="2"), "its XML has no body named object_2"),
        (lambda pack: pack.update(object_permissions={}), "everything about object_1 would be withheld"),
        (lambda pack: pack["object_permissions"].update(object_9_permissions={}), "belongs to no object"),
        (
            lambda pack: pack.update(schematic=_part("pulley", [1, 0, 0])),
            "pulley, of which the task does not tell",
        ),
        (lambda pack: pack.update(schematic=_part("cord", "object_4", [1, 0, 0])), "schematic.0 names object_4, which"),
        (lambda pack: pack.update(schematic=_part("cord", "object_1")), "a cord has two points or more"),
        (lambda pack: pack["metadata"].update(task="Use apply_force."), "the task names the tool apply_force"),
        (lambda pack: pack["metadata"].update(task="Push object_3."), "the task names object_3, which is not listed"),
        (lambda pack: pack.update(disabled_tools={"fly": "x"}), "disabled_tools names fly, which is no tool"),
        (lambda pack: pack.update(disabled_tools={"get_torque": " "}), "disabled_tools.get_torque gives no reason"),
        (lambda pack: pack.update(requires=["fly"]), "requires names fly, which is no tool"),
        (lambda pack: pack.update(disabled_tools={"step": "x"}), "requires names step, which the scene disables"),
        (lambda pack: pack.update(category="easy-single-hidden"), "a hidden scene has no hidden object"),
        (lambda pack: pack["knobs"]["m"].update(meaning=""), "knobs.m.meaning is missing"),
        (lambda pack: pack["knobs"]["m"].update(canonical=9.0), "lies outside the range"),
        (lambda pack: pack.update(apply={}), "knobs.m is used nowhere"),
        (lambda pack: pack["knobs"]["m"].update(canonical=3.0), "differs from the canonical knobs in body_mass"),
        (lambda pack: pack["knobs"]["m"].update(uniform=[1, 2]), "give exactly one of"),
    ],
)
def test_lint_reports_each_fault_of_a_pack(
    change: Callable[[dict[str, Any]], None], sentence: str, author: Author
) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, change)
    assert any(sentence in fault for fault in lint(files)), lint(files)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('timestep="0.005"', 'timestep="0.002"', "the time step is 0.002 s"),
        ("<worldbody>", "<worldbody><!-- the mass is 2 -->", "the XML has comments"),
        ("</body>", '<body name="knob"><geom size="0.01"/></body></body>', "body 'knob' has no joint"),
        (
            "<worldbody>",
            '<worldbody><body name="object_7"><freejoint/><geom size="1"/></body>',
            "can move but is no object",
        ),
        ("<worldbody>", "<worldbody><body/>", "does not compile"),
        ("</mujoco>", "", "does not compile"),
    ],
)
def test_lint_reports_each_fault_of_the_model(old: str, new: str, sentence: str, author: Author) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.replace(files.mjcf, old, new)
    if "body/>" in new:
        author.replace(files.mjcf, "<body/>", '<body pos="0 0"><joint type="free"/></body>')
    assert any(sentence in fault for fault in lint(files)), lint(files)


def test_lint_reports_friction_that_a_created_ball_overrides(author: Author) -> None:
    files = author.write(Category.EASY_SINGLE_CREATION)
    author.replace(
        files.mjcf, "<worldbody>", '<worldbody><geom name="floor" type="plane" size="9 9 0.1" friction="0.2 0 0"/>'
    )
    assert any(
        "a created ball has friction 1, which would act instead of that of floor" in fault for fault in lint(files)
    )


def test_lint_reports_gaps_in_object_numbers(author: Author) -> None:
    files = author.write(Category.EASY_SINGLE)
    author.edit(files, lambda pack: pack["objects"]["object_1"].update(object_id="2"))
    author.replace(files.mjcf, 'body name="object_1"', 'body name="object_2"')
    assert any("number them from object_1 on without gaps" in fault for fault in lint(files)), lint(files)


@pytest.mark.parametrize(
    "scene",
    [scene if scene % 5 == 0 else pytest.param(scene, marks=pytest.mark.extended) for scene in SCENES],
)
def test_the_stored_key_is_that_of_theory_and_engine_and_the_scene_is_sane(scene: int) -> None:
    files = find_pack(scene)
    subject = Subject.open(files)
    draw = subject.draw(0)
    key, measured = subject.truth(draw), subject.measured(draw)
    assert subject.agrees(subject.pack.answer, key, 0.05)
    assert measured is None or subject.agrees(measured, key, 0.25)
    assert reasons_of([check_sane(subject, [0], lint(files))]) == []


@pytest.mark.parametrize(
    "scene", [scene if scene in PLAYED else pytest.param(scene, marks=pytest.mark.extended) for scene in SCENES]
)
async def test_the_reference_finds_the_key_through_mcp(scene: int, memory: EpisodeConnector) -> None:
    """Plays only seed 0. `physment-eval verify --all`, which runs each night, plays 20 seeds."""
    subject = Subject.open(find_pack(scene))
    assert reasons_of([check_key(subject, [await play_reference(subject, 0, memory)])]) == []


@pytest.mark.parametrize(
    "scene",
    [
        *SCENES[:100:60],
        *[pytest.param(scene, marks=pytest.mark.extended) for scene in SCENES[::10] if scene not in SCENES[:100:60]],
    ],
)
async def test_twins_and_steps_hold_for_a_sample_of_the_scenes(scene: int, memory: EpisodeConnector) -> None:
    """The reference plays seed 0 through MCP and seed 1 on a session, without a server."""
    files = find_pack(scene)
    subject = Subject.open(files)
    draw = subject.draw(1)
    session = subject.session(draw)
    assert subject.solution.solve is not None
    assert not (await drive(session, subject.solution.solve)).failure
    prompt, answer = opening_prompt(session, PromptOptions(budget=BUDGET)), cast("JsonValue", session.state.answer)
    assert subject.agrees(answer, subject.truth(draw), 0.5)
    answered = returned("answer", answer=answer, steps=session.state.steps)
    first = await play_reference(subject, 0, memory)
    second = episode(turn("", answered), key=episode_key(scene, seed=1), answer=answer, prompt=prompt)
    assert all((grade_steps(second, step_values(files, subject.pack, draw.knobs)) or {}).values())
    assert reasons_of([await check_twins(subject, [first, second])]) == []


def reasons_of(checks: Sequence[Check]) -> list[str]:
    """Return the faults that checks report, except equal keys, because two seeds may select the same choice."""
    reasons = [reason for check in checks for reason in check.reasons if reason != "all seeds have the same key"]
    return [reason.split(":")[0] for reason in reasons]


def test_the_stored_certificates_match_these_packs_and_all_passed() -> None:
    """After changing a pack, run `make verify`."""
    stored = read_certificates(default_folder())
    assert stored is not None
    certificates = {certificate.scene: certificate for certificate in stored.scenes}
    assert list(certificates) == SCENES
    for files in list_packs():
        certificate = certificates[files.scene_id]
        assert certificate.passed
        assert tuple(check.name for check in certificate.checks) == certificates_of(read_pack(files))
        assert certificate.seeds >= 20
        assert certificate.pack == pack_hash(files), f"scene {files.scene_id} has changed since it was verified"


def test_every_category_and_every_tool_is_used() -> None:
    packs = [read_pack(files) for files in list_packs()]
    counts = {category: sum(pack.category is category for pack in packs) for category in Category}
    del counts[Category.OPEN]
    assert list(counts.values()) == [9, 5, 5, 15, 5, 5, 15, 5, 5, 15, 5, 5, 11]
    stored = read_certificates(default_folder())
    assert stored is not None
    from evaluator.answers.engine import TOOL_NAMES

    used = {tool: 0 for tool in TOOL_NAMES if tool != "answer"}
    for certificate in stored.scenes:
        tools = certificate.checks[CERTIFICATES.index("difficulty")].figures["tools"]
        assert isinstance(tools, list)
        for tool in tools:
            used[tool] += 1
    assert not [tool for tool, count in used.items() if count < 2]


def test_readings_are_equal_if_they_differ_only_by_rounding() -> None:
    assert same({"a": [1.0, "x", None]}, {"a": (1.0 + 1e-13, "x", None)})
    assert not same({"a": 1.0}, {"b": 1.0})
    assert not same([1.0], [1.0, 2.0])
    assert not same(1.0, 1.0 + 1e-6)
    assert not same(math.nan, 1.0)
