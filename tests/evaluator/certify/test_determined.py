"""Tests that certificate 12 detects each way in which readings and the family of laws can leave the answer open."""

import pytest

from evaluator.certify.determined import check_determined
from evaluator.certify.lint import lint
from evaluator.certify.records import CERTIFICATES, PREDICTION_CERTIFICATES
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, certify
from evaluator.records.episode import Episode
from scenes import Category, PackFiles
from tests.builders.author import TEMPLATE_SEEDS, Author


@pytest.fixture
def files(author: Author) -> PackFiles:
    return author.write(Category.HARD_SINGLE)


def also(files: PackFiles, code: str) -> None:
    """Append code to a solution."""
    with files.solution.open("a", encoding="utf-8") as solution:
        solution.write(code)


def test_a_family_of_which_the_readings_leave_one_law_determines_the_answer(
    files: PackFiles, episodes: list[Episode]
) -> None:
    check = check_determined(Subject.open(files), episodes)
    assert check.reasons == ()
    assert check.figures["ambiguous_seeds"] == 0
    assert check.figures["plausible_right"] == 1.0


def test_a_law_that_fits_and_answers_otherwise_leaves_the_answer_open(
    files: PackFiles, episodes: list[Episode]
) -> None:
    also(
        files,
        "\n\nstated = rivals\n\n\ndef rivals(readings):\n"
        '    """The stated laws, and the best of them with a bend beyond the forces that can be tried."""\n'
        "    from dataclasses import replace\n\n"
        "    fits = stated(readings)\n"
        "    best = min(fits.values(), key=lambda fit: fit.chi_square)\n"
        "    return fits | {'bend': replace(best, answer=1.2 * best.answer)}\n",
    )
    check = check_determined(Subject.open(files), episodes)
    assert len(check.reasons) == TEMPLATE_SEEDS
    assert check.reasons[0].startswith("seed 0: 'bend' fits the readings as well as 'dry and linear' (chi-square")
    assert "and gives 34." in check.reasons[0]
    assert float(check.reasons[0].rpartition("the key is ")[2]) == pytest.approx(28.5, rel=1e-6)
    assert check.figures["ambiguous_seeds"] == TEMPLATE_SEEDS


def test_constants_that_the_readings_leave_open_are_detected(
    author: Author, files: PackFiles, episodes: list[Episode]
) -> None:
    author.replace(files.solution, "ERROR_M_S = 2e-3", "ERROR_M_S = 0.2")
    reasons = check_determined(Subject.open(files), episodes).reasons
    assert any("the readings leave the constants of 'dry and linear' open: only" in reason for reason in reasons)


def test_errors_that_are_stated_too_small_are_detected(
    author: Author, files: PackFiles, episodes: list[Episode]
) -> None:
    author.replace(files.solution, "ERROR_M_S = 2e-3", "ERROR_M_S = 1e-7")
    reasons = check_determined(Subject.open(files), episodes).reasons
    assert any("has a reduced chi-square of" in reason for reason in reasons), reasons


def test_the_drawn_law_must_not_be_excluded(author: Author, files: PackFiles, episodes: list[Episode]) -> None:
    author.replace(files.solution, "def fit(", 'def structure(knobs):\n    return "linear and quadratic"\n\n\ndef fit(')
    reasons = check_determined(Subject.open(files), episodes[:1]).reasons
    assert "seed 0: 'linear and quadratic', which was drawn, is excluded by 4 standard deviations" in reasons


def test_the_drawn_law_must_be_a_member(author: Author, files: PackFiles, episodes: list[Episode]) -> None:
    author.replace(files.solution, "def fit(", 'def structure(knobs):\n    return "viscous"\n\n\ndef fit(')
    reasons = check_determined(Subject.open(files), episodes[:1]).reasons
    assert reasons == ("seed 0: rivals has no member 'viscous', which was drawn",)


def test_members_are_compared_on_the_same_readings(author: Author, files: PackFiles, episodes: list[Episode]) -> None:
    author.replace(files.solution, "for force, v in pushes]", "for force, v in pushes[sum(terms) - 1 :]]")
    reasons = check_determined(Subject.open(files), episodes[:1]).reasons
    assert reasons == ("seed 0: the members of rivals are fitted to different numbers of readings",)


def test_an_asked_state_that_a_disturbance_drives_away_is_detected(
    author: Author, files: PackFiles, episodes: list[Episode]
) -> None:
    # The added force is 0 at 28.5 m/s, the key of seed 0 without air, and drives the cart away from this speed.
    law = {"on": "object_1", "force": ["50 * (vx - 28.5) if abs(vx - 28.5) < 3 else 0", "0", "0"]}
    author.replace(files.mjcf, 'density="5e-08"', 'density="0"')
    author.edit(files, lambda pack: pack.update(laws=[law], derive=pack["derive"] | {"k": "0.0"}))
    reasons = check_determined(Subject.open(files), episodes[:1]).reasons
    assert [reason.split(" under ")[0] for reason in reasons] == [
        "seed 0: let go +2% off the asked state",
        "seed 0: let go -2% off the asked state",
    ]
    assert reasons[0].endswith("at most 1.00% may be left of a stable state")


def test_an_asked_state_that_is_no_equilibrium_is_detected(
    author: Author, files: PackFiles, episodes: list[Episode]
) -> None:
    author.replace(files.solution, "asked = theory(knobs)", "asked = 1.1 * theory(knobs)")
    reasons = check_determined(Subject.open(files), episodes[:1]).reasons
    assert any("let go +0% off the asked state" in reason for reason in reasons), reasons


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("two of: a constant force;", "a constant force,", "the task states no family of laws"),
        ("the square of the speed.", "a power of the speed.", "the words of family.quadratic"),
    ],
)
def test_a_task_that_does_not_state_the_family_is_detected(
    old: str, new: str, sentence: str, author: Author, files: PackFiles, episodes: list[Episode]
) -> None:
    author.replace(files.json, old, new)
    assert any(sentence in fault for fault in lint(files)), lint(files)
    assert any(sentence in reason for reason in check_determined(Subject.open(files), episodes[:1]).reasons)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("rivals", "solution.py defines no rivals: fit each law of the family"),
        ("settles", "the task asks for an equilibrium, but solution.py defines no settles: show that it is stable"),
    ],
)
def test_lint_reports_what_a_solution_with_a_family_lacks(
    name: str, sentence: str, author: Author, files: PackFiles
) -> None:
    author.replace(files.solution, f"def {name}(", f"def other_{name}(")
    assert lint(files) == [sentence]


def test_a_family_has_at_least_two_laws(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack.update(family={"dry": "a constant force"}))
    assert any("family names fewer than two laws" in fault for fault in lint(files))


async def test_a_pack_without_a_family_is_a_fault_and_is_not_weighed(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack.pop("family"))
    assert any("family is missing" in fault for fault in lint(files)), lint(files)
    certificate = await certify(files, 1, MemoryConnector(files.folder.parent))
    assert tuple(check.name for check in certificate.checks) == CERTIFICATES + PREDICTION_CERTIFICATES
