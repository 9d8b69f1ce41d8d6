"""Tests that certificates 7 to 10 and lint's rules for prediction scenes each detect a planted fault."""

from collections.abc import Callable
from typing import Any

import pytest

from evaluator.answers.keys import KeyRing
from evaluator.certify.attempts import at_least, at_most, check_structure, check_tempting, check_unstageable
from evaluator.certify.keys import check_instrument
from evaluator.certify.lint import lint
from evaluator.certify.records import CERTIFICATES, FAMILY_CERTIFICATES, PREDICTION_CERTIFICATES, Check
from evaluator.certify.subject import Subject
from evaluator.certify.twins import check_twins
from evaluator.certify.verify import MemoryConnector, certify, play_reference
from evaluator.records.episode import Episode
from scenes import Category, PackFiles
from tests.builders.author import TEMPLATE_SEEDS, Author
from tests.builders.records import episode

Change = Callable[[dict[str, Any]], None]


@pytest.fixture
def files(author: Author) -> PackFiles:
    return author.write(Category.HARD_SINGLE)


def only_reason(check: Check) -> str:
    (reason,) = check.reasons
    assert not check.passed
    return reason


async def test_the_template_of_a_scene_with_a_prediction_has_all_certificates(files: PackFiles) -> None:
    certificate = await certify(files, TEMPLATE_SEEDS, MemoryConnector(files.folder.parent))
    assert [check for check in certificate.checks if not check.passed] == []
    names = tuple(check.name for check in certificate.checks)
    assert names == CERTIFICATES + PREDICTION_CERTIFICATES + FAMILY_CERTIFICATES
    figures = {check.name: check.figures for check in certificate.checks}
    assert "wrong_by_rote" not in figures["difficulty"]
    assert figures["unstageable"]["stage_refused"] == TEMPLATE_SEEDS
    assert figures["instrument"]["calls"] == 30


async def test_what_can_be_brought_about_is_stageable(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack["limits"].update(force=100))
    check = await check_unstageable(Subject.open(files), TEMPLATE_SEEDS)
    assert "stage is right at seed 0: what is asked can be brought about" in check.reasons[0]


async def test_a_stage_must_not_fail_by_itself(author: Author, files: PackFiles) -> None:
    author.replace(files.solution, "readings = yield steady(ASKED_N)", "readings = yield steady(1 / 0)")
    check = await check_unstageable(Subject.open(files), 1)
    assert "stage fails at seed 0, although nothing was refused: ZeroDivisionError" in only_reason(check)


async def test_a_fixed_batch_that_finds_the_answer_is_detected(author: Author, files: PackFiles) -> None:
    author.replace(files.solution, "def batch(task)", "def former_batch(task)")
    with files.solution.open("a", encoding="utf-8") as solution:
        solution.write(
            "\n\ndef batch(task):\n"
            "    readings = yield [made for force in FORCES_N for made in steady(force)]\n"
            "    pushes = [(force, readings[5 * n + 4]['velocity'][0]) for n, force in enumerate(FORCES_N)]\n"
            "    best = min(TERMS.values(), key=lambda terms: law(pushes, terms)[1])\n"
            "    yield [answer(speed(*law(pushes, best)[0], ASKED_N))]\n"
        )
    reason = only_reason(await check_unstageable(Subject.open(files), TEMPLATE_SEEDS))
    assert reason == "batch is right on 3 of 3 seeds; at most a third may be"


async def test_a_batch_is_one_iteration_of_at_most_sixty_calls(author: Author, files: PackFiles) -> None:
    author.replace(
        files.solution,
        "[*steady(7.0), *steady(10.0)]",
        "[*steady(7.0), *steady(10.0)]\n    yield [call('find_objects')]",
    )
    reason = only_reason(await check_unstageable(Subject.open(files), 1))
    assert "batch makes 11 calls in 2 iterations before its answer; it is one iteration of at most 60" in reason
    author.replace(files.solution, "    yield [call('find_objects')]\n", "")
    author.replace(files.solution, "[*steady(7.0), *", "[*steady(7.0), *[call('find_objects')] * 51, *")
    author.edit(files, lambda pack: pack["limits"].update(calls=150))
    assert "batch makes 61 calls in 1 iterations" in only_reason(await check_unstageable(Subject.open(files), 1))


async def test_a_question_that_proportion_answers_is_found_by_the_attackers(author: Author, files: PackFiles) -> None:
    # Only a resistance in proportion to the speed is left.
    author.edit(files, lambda pack: pack["derive"].update(f="0.0", c="linear", k="0.0"))
    author.replace(files.mjcf, 'frictionloss="3"', 'frictionloss="0"')
    author.replace(files.solution, "SETTLE_S = 15.0", "SETTLE_S = 10.0")
    reasons = (await check_unstageable(Subject.open(files), TEMPLATE_SEEDS)).reasons
    assert "the attacker proportional is right on 3 of 3 seeds; at most 20% may be" in reasons
    assert "the attacker sweep is right on 3 of 3 seeds; at most 20% may be" in reasons


async def test_stages_and_a_batch_are_needed(author: Author, files: PackFiles) -> None:
    author.replace(files.solution, "def stage(task)", "def attempt(task)")
    author.replace(files.solution, "def batch(task)", "def attempt_at_once(task)")
    reasons = (await check_unstageable(Subject.open(files), 1)).reasons
    assert [reason.split(":")[0] for reason in reasons] == [
        "solution.py defines no stage",
        "solution.py defines no batch",
    ]


def test_a_shortcut_that_is_nearly_right_is_not_tempting(author: Author, files: PackFiles) -> None:
    author.replace(files.solution, '"root": known * sqrt(ASKED_N / 10)', '"close": 1.09 * theory(knobs)')
    reason = only_reason(check_tempting(Subject.open(files), TEMPLATE_SEEDS))
    assert "the shortcut 'close' misses by more than 10 % on only 0 of 3 seeds" in reason


def test_a_shortcut_is_needed(author: Author, files: PackFiles) -> None:
    author.replace(files.solution, "def naive(", "def shortcuts(")
    assert "defines no naive" in only_reason(check_tempting(Subject.open(files), 1))


def test_a_shortcut_to_a_choice_is_wrong_if_it_names_another_option(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack["answer_spec"].update(kind="choice", options=["10", "11"]))
    author.replace(files.solution, "def theory(knobs)", 'def theory(knobs):\n    return "10"\n\n\ndef speed_at(knobs)')
    author.replace(
        files.solution, "def naive(", 'def naive(knobs):\n    return {"same": "10", "next": 11}\n\n\ndef old('
    )
    check = check_tempting(Subject.open(files), TEMPLATE_SEEDS)
    assert dict(check.figures) == {"same_off": 0, "next_off": TEMPLATE_SEEDS}


LABEL = "def structure(knobs):\n    "


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("def fit(", f'{LABEL}return "one"\n\n\ndef fit(', "20 seeds draw only 1 structures"),
        ("def fit(", f'{LABEL}return knobs["kind"][:3]\n\n\ndef fit(', "20 seeds draw only 2 structures"),
        ("TERMS[structure]", "(0, 1, 2)", "is wrong on only 0 of the 2 seeds with another structure"),
        ("TERMS[structure]", "(0,)", "fit with the true structure is right on only 0 of 3 seeds"),
        ("def fit(", "def fitted(", "solution.py defines no fit"),
        ("def fit(", "def fitted(", "solution.py defines no structure"),
    ],
)
def test_a_structure_that_need_not_be_found_is_detected(
    old: str, new: str, sentence: str, author: Author, files: PackFiles, episodes: list[Episode]
) -> None:
    author.replace(files.solution, old, new)
    check = check_structure(Subject.open(files), episodes)
    assert not check.passed
    assert any(sentence in reason for reason in check.reasons), check.reasons


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda pack: pack["limits"].update(calls=100), "uses 30 of 100 calls on the median seed: lower the limit"),
        (lambda pack: pack["limits"].update(lab_time=300), "uses 90 of 300 s of laboratory time on the median seed"),
        (lambda pack: pack["limits"].update(lab_time=80), "uses 90 s of laboratory time, more than the limit of 80"),
        (lambda pack: pack["limits"].update(calls=None), "limits.calls is missing"),
        (lambda pack: pack["instruments"].update(velocity=0), "instruments.velocity is missing or 0"),
        (lambda pack: pack.update(instruments=None), "instruments.position is missing or 0"),
        (
            lambda pack: pack["object_permissions"]["object_1_permissions"].update(spin=True),
            "instruments.spin is missing or 0",
        ),
    ],
)
def test_limits_and_instruments_are_stated_and_needed(
    change: Change, sentence: str, author: Author, files: PackFiles, episodes: list[Episode]
) -> None:
    author.edit(files, change)
    check = check_instrument(Subject.open(files), episodes)
    assert any(sentence in reason for reason in check.reasons), check.reasons


async def test_a_reference_that_is_refused_does_not_keep_the_limits(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack["limits"].update(force=9.5))
    subject = Subject.open(files)
    played = [await play_reference(subject, 0, MemoryConnector(files.folder.parent))]
    assert "seed 0: the reference was refused" in check_instrument(subject, played).reasons[0]


def test_a_reference_makes_at_most_150_calls(files: PackFiles, episodes: list[Episode]) -> None:
    turns = episodes[0].turns
    longer = episodes[0].model_copy(update={"turns": (*(turns[:-1] * 6), turns[-1])})
    assert "the reference makes 180 calls; at most 150" in check_instrument(Subject.open(files), [longer]).reasons[0]


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda pack: pack["limits"].pop("lab_time"), "limits.lab_time is missing"),
        (lambda pack: pack.pop("instruments"), "instruments.velocity is missing or 0"),
        (lambda pack: pack["limits"].update(forse=1), "limits.forse"),
    ],
)
def test_lint_reports_limits_and_instruments_that_are_not_stated(
    change: Change, sentence: str, author: Author, files: PackFiles
) -> None:
    author.edit(files, change)
    assert any(sentence in fault for fault in lint(files)), lint(files)


@pytest.mark.parametrize("name", ["fit", "naive", "batch", "stage"])
def test_lint_reports_what_the_solution_of_a_prediction_lacks(name: str, author: Author, files: PackFiles) -> None:
    author.replace(files.solution, f"def {name}(", f"def other_{name}(")
    assert any(f"solution.py defines no {name}" in fault for fault in lint(files)), lint(files)


def test_lint_reports_a_structure_that_is_neither_defined_nor_drawn(author: Author, files: PackFiles) -> None:
    text = files.json.read_text(encoding="utf-8")
    files.json.write_text(text.replace('"kind": {', '"sort": {').replace("if kind !=", "if sort !="), encoding="utf-8")
    sentence = "solution.py defines no structure, and no drawn value is named kind"
    assert any(sentence in fault for fault in lint(files)), lint(files)


def test_lint_reports_an_object_that_may_be_absent(author: Author, files: PackFiles) -> None:
    author.replace(files.mjcf, '<body name="object_1"', '<body present="dry > 1" name="object_1"')
    assert any("object_1 has the attribute present" in fault for fault in lint(files)), lint(files)


def test_lint_compiles_every_structure_of_a_model_with_parts_that_may_be_absent(
    author: Author, files: PackFiles
) -> None:
    carrier = (
        '<body name="carrier" pos="0 2 1" present="k &lt; 0.1"><joint name="carrier_joint" type="slide" axis="1 0 0"/>'
        '<geom size="0.1" mass="1"/></body>'
    )
    author.replace(files.mjcf, "</worldbody>", f"{carrier}</worldbody>")
    faults = lint(files)
    assert faults
    assert all("so the time of a step tells of the draw" in fault for fault in faults), faults
    rod = '<equality><joint joint1="object_1_joint" joint2="carrier_joint"/></equality>'
    author.replace(files.mjcf, "</worldbody>", f"</worldbody>{rod}")
    (fault,) = lint(files)
    assert fault.startswith("seed 1 cannot be set up: ")
    assert "carrier_joint" in fault


@pytest.mark.parametrize(
    ("quantity", "kind"), [("f", "rows of the constraint solver at the start"), ("k", "bodies in a fluid")]
)
def test_lint_reports_a_part_that_a_drawn_zero_switches_off(
    quantity: str, kind: str, author: Author, files: PackFiles
) -> None:
    """Here the pack declares the part neither in a law nor in a condition, so lint must find it in the MuJoCo model."""
    author.edit(files, lambda pack: pack["derive"].update({quantity: pack["derive"][quantity].replace("1e-9", "0.0")}))
    assert any(f"the number of {kind} is" in fault for fault in lint(files)), lint(files)


def test_lint_names_the_seed_at_which_a_law_cannot_be_evaluated(author: Author, files: PackFiles) -> None:
    law = {"on": "object_1", "force": ["-quadratic * vx * hypot(vx, vy)", "0", "0"], "present": "k > 0.1"}
    author.edit(files, lambda pack: pack.update(laws=[law]))
    assert lint(files) == []
    author.edit(files, lambda pack: pack.update(laws=[law | {"force": ["sqrt(0.1 - k)", "0", "0"]}]))
    (fault,) = lint(files)
    assert fault.startswith("seed 1 cannot be set up: ")
    assert "laws[0].force[0]: a function or a power is not defined for its arguments at the start" in fault


def test_lint_tries_a_law_in_motion_where_it_is_not_present(author: Author, files: PackFiles) -> None:
    law = {"on": "object_1", "force": ["sqrt(0.0001 - x ** 2)", "0", "0"], "present": "k < 0"}
    author.edit(files, lambda pack: pack.update(laws=[law]))
    (fault,) = lint(files)
    assert "at seed 0 a law that is not present has no finite value in motion" in fault


async def test_twins_are_compared_in_everything_whatever_the_limit_of_calls(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack["limits"].update(calls=1))
    # Only the last reading tool shows the centre of mass. A session limited to one call would not reach this tool.
    may = {"geom_type": False, "geom_size": False, "body_pos": True, "body_mass": True, "velocity": False}
    author.edit(files, lambda pack: pack["object_permissions"].update(object_1_permissions=may))
    author.edit(files, lambda pack: pack["apply"].update({"geom[object_1_geom].pos": ["0.1 * k", "0", "0"]}))
    author.replace(files.mjcf, 'size="0.1 0.1 0.1"', 'pos="0 0 0" size="0.1 0.1 0.1"')
    check = await check_twins(Subject.open(files), [episode(), episode()])
    assert "at the start get_center_of_mass() distinguishes seed 1 from seed 0" in check.reasons


def test_a_knob_is_used_if_a_law_or_a_condition_names_it(author: Author, files: PackFiles) -> None:
    spare = {"canonical": 1, "choice": [1, 2], "meaning": "whether a ball lies there"}
    author.edit(files, lambda pack: pack["knobs"].update(spare=spare))
    assert lint(files) == ["knobs.spare is used nowhere"]
    mark = '<geom size="0.1" pos="0 5 1" contype="0" conaffinity="0" present="spare == 1"/>'
    author.replace(files.mjcf, "</worldbody>", f"{mark}</worldbody>")
    assert lint(files) == []


def test_shares_are_exact_on_twenty_seeds_and_favour_the_scene_on_fewer() -> None:
    assert (at_most(0.2, 20, 20), at_most(1 / 3, 20, 20), at_least(2 / 3, 20, 20)) == (4, 6, 14)
    assert (at_most(0.2, 3, 3), at_most(0.6, 2, 2), at_least(2 / 3, 2, 2), at_least(0.5, 1, 2)) == (1, 2, 1, 0)
    assert at_least(0.5, 0, 20) == 0


def test_an_open_world_whose_law_cannot_be_stated_is_reported_and_graded_without_it(author: Author) -> None:
    files = author.write(Category.OPEN)
    assert any("asks agents for the law, and it cannot be graded" in fault for fault in lint(files)), lint(files)
    assert KeyRing(files.folder.parent).law(files.scene_id, 0) is None
