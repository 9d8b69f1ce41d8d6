"""Tests of questions for a distance, a smallest force and an acting term: closed forms, the engine, and wording."""

import math
import random

import numpy as np
import pytest

from evaluator.certify.worlds import engine_answers
from scenes.errors import WorldError
from scenes.worlds.answering import answers, crossing
from scenes.worlds.asking import Flags, covering, drawn, nearby
from scenes.worlds.catalogue import FORMS, forms_of
from scenes.worlds.drawing import draw_constants, draw_structure, options_with
from scenes.worlds.experiment import Situation, simulated
from scenes.worlds.levels import GRAMMAR, KINDS, difficulty_of
from scenes.worlds.packs import pack_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question, tolerance
from scenes.worlds.records import WorldRecord
from scenes.worlds.refits import Refits
from scenes.worlds.rivals import mistakable
from scenes.worlds.tasks import task_of
from scenes.worlds.terms import Structure, Term

DRAG = (Term("linear drag"),)


def record_of(structure: Structure, constants: dict[str, float], questions: tuple[Question, ...]) -> WorldRecord:
    """Return a record of a world, to which no acceptance test was applied."""
    return WorldRecord(
        grammar=GRAMMAR, level=5, index=0, split="train", salt="s", apparatus=structure.apparatus,
        terms=tuple((term.form, term.modulations) for term in structure.terms), constants=constants,
        radius=6.0, force=5.0, looks=40, noise=0.002, questions=questions,
    )  # fmt: skip


def told(apparatus: Apparatus, looks: int = 40) -> Situation:
    return Situation(apparatus, 6.0, 5.0, looks, 0.002)


def least(way: tuple[float, ...], size: float, lasting: float = 2.0) -> Question:
    """Return a question for the smallest force on one body."""
    nothing = (0.0,) * len(way)
    return Question("push", nothing, nothing, way, 0.0, lasting, "push", size=size)


def test_the_least_force_against_drag_is_that_of_the_closed_form() -> None:
    structure, constants = Structure(Apparatus.PUCK, DRAG), {"m": 1.6, "c0": 0.7}
    question = least((0.0, -1.0), 3.2)
    # x = F/(m c) (T - (1 - exp(-c T))/c) from rest
    reach = (2.0 - (1 - math.exp(-0.7 * 2.0)) / 0.7) / (1.6 * 0.7)
    (found,) = answers(structure, constants, [question], 0.01)
    assert found == pytest.approx([3.2 / reach], rel=1e-7)
    assert engine_answers(record_of(structure, constants, (question,))) == pytest.approx([3.2 / reach], rel=1e-5)
    several = {"m": np.array([0.8, 1.6]), "c0": 0.7}
    assert answers(structure, several, [question], 0.01)[0] == pytest.approx([1.6 / reach, 3.2 / reach], rel=1e-7)


@pytest.mark.parametrize("size", [-1.0, 1e4])
def test_a_force_that_no_one_needs_or_can_find_has_no_value(size: float) -> None:
    structure, constants = Structure(Apparatus.GLIDER, (Term("friction"),)), {"m": 1.0, "c0": 0.5}
    question = least((1.0,), size)
    assert np.isnan(answers(structure, constants, [question], 0.03)).all()
    assert np.isnan(engine_answers(record_of(structure, constants, (question,)))).all()


def test_a_crossing_is_found_where_there_is_exactly_one() -> None:
    def beyond(points: np.ndarray) -> np.ndarray:
        return np.stack([points[:, 0] ** 3 - 5.0, (points[:, 1] - 1) * (points[:, 1] - 2), 1 - points[:, 2]], axis=1)

    grid = np.repeat(np.linspace(0, 3, 7)[:, None], 3, axis=1) + 0.01
    found = crossing(beyond, grid, beyond(grid), 1e-12)
    assert found[0] == pytest.approx(5 ** (1 / 3), abs=1e-9)
    assert np.isnan(found[1:]).all()  # the second function changes its sign twice, the third falls


@pytest.mark.parametrize("clock", [0.0, 12.0])
def test_the_distance_of_two_pucks_is_alike_in_theory_and_in_the_engine(clock: float) -> None:
    structure = Structure(Apparatus.PAIR, (*DRAG, Term("mutual power"), Term("companion")))
    constants = draw_constants(structure, random.Random(2))
    question = Question(
        "apart", (1.0, 0.5, -2.0, 1.0), (2.0, -1.0, 0.0, 0.0), (0.0, 6.0, 0.0, 0.0), clock, 2.0, "apart"
    )
    theory = answers(structure, constants, [question], 0.01)[:, 0]
    assert engine_answers(record_of(structure, constants, (question,))) == pytest.approx(theory, abs=1e-4)
    without_forces = Structure(Apparatus.PAIR, DRAG)
    still = Question("apart", (3.0, 0.0, 0.0, 4.0), (0.0,) * 4, (0.0,) * 4, 0.0, 1.0, "apart")
    assert answers(without_forces, {"m": 1.0, "m2": 1.0, "c0": 0.5}, [still], 0.1) == pytest.approx(5.0)


def test_an_option_is_right_if_it_alone_acts() -> None:
    structure = Structure(Apparatus.PUCK, (*DRAG, Term("wind")))
    constants = draw_constants(structure, random.Random(1))

    def which(*options: str) -> float:
        nothing = (0.0, 0.0)
        question = Question("which", nothing, nothing, nothing, 0.0, 0.0, "which", options=options)
        assert engine_answers(record_of(structure, constants, (question,))) == pytest.approx(
            answers(structure, constants, [question], 0.1)[:, 0], nan_ok=True
        )
        return float(answers(structure, constants, [question], 0.1)[0, 0])

    assert which("saddle", "wind", "turn") == 2
    assert math.isnan(which("saddle", "turn"))
    assert math.isnan(which("linear drag", "wind"))
    # The difference between the numbers of two options is larger than the tolerance.
    assert tolerance(np.array(4.0)) < 0.5


@pytest.mark.parametrize("apparatus", Apparatus)
def test_options_have_one_form_of_the_structure_and_none_that_is_alike(apparatus: Apparatus) -> None:
    rng, places = random.Random(4), set[int]()
    for _ in range(40):
        structure = draw_structure(difficulty_of(5).changed(apparatuses=(apparatus,)), rng)
        there = {term.form for term in structure.terms}
        asked = rng.choice(structure.terms).form
        options = options_with(structure, asked, 4, rng)
        assert there.intersection(options) == {asked}
        assert len(set(options)) == 4
        assert {form.name for form in forms_of(apparatus)}.issuperset(options)
        assert not ("linear drag" in there and "saturating drag" in options)
        free = [form.name for form in forms_of(apparatus) if form.group == FORMS[asked].group and form.name != asked]
        if not there.intersection(free) and len(free) > 3:  # so that the group alone does not reveal the option
            assert sum(FORMS[name].group == FORMS[asked].group for name in options) >= 2
        places.add(options.index(asked))
    assert places == {0, 1, 2, 3}


@pytest.mark.parametrize(
    "apparatus", [pytest.param(one, marks=pytest.mark.extended if one.flat else ()) for one in Apparatus]
)
def test_each_kind_is_drawn_where_it_means_something(apparatus: Apparatus) -> None:
    difficulty, rng = difficulty_of(5).changed(apparatuses=(apparatus,)), random.Random(6)
    seen = set[str]()
    for _ in range(8):
        structure = draw_structure(difficulty, rng)
        constants = draw_constants(structure, rng)
        asked = drawn(structure, constants, told(apparatus), difficulty, rng)
        assert len({question.kind for question in asked}) == 3
        assert sum(question.kind == "which" for question in asked) <= 1
        seen |= {question.kind for question in asked}
        guesses = nearby(structure, constants, asked, told(apparatus))
        for question, guess in zip(asked, guesses["those in the nearest allowed situation"], strict=True):
            assert guess == 5.0 if question.what == "push" else math.isnan(guess) == bool(question.options)
    none = {Apparatus.WHEEL: {"far", "apart"}, Apparatus.PAIR: set[str]()}.get(apparatus, {"apart"})
    assert seen == set(KINDS) - none


def test_kinds_that_leave_nothing_to_predict_are_refused() -> None:
    for kinds in (("which",), ("far", "which"), ("apart",)):
        with pytest.raises(WorldError, match="without a number to predict"):
            difficulty_of(3).changed(kinds=kinds)


def test_readings_tell_options_apart_unless_one_does_what_the_other_does() -> None:
    structure = Structure(Apparatus.GLIDER, (Term("power friction"), Term("spring")))
    nothing = (0.0,)
    asked = Question("which", nothing, nothing, nothing, 0.0, 0.0, "which", options=("friction", "power friction"))

    def found(power: float) -> bool:
        constants = {"m": 1.2, "c0": 0.4, "p0": power, "k1": 0.9, "w1": 0.3}
        course = simulated(structure, constants, told(Apparatus.GLIDER), 1)
        refits = Refits(structure, constants, told(Apparatus.GLIDER), course)
        return mistakable(refits, constants, asked, random.Random(1))

    assert not found(2.3)
    assert found(1.0)


def test_a_task_says_what_is_asked_and_what_a_fresh_start_is() -> None:
    structure = Structure(Apparatus.PAIR, (*DRAG, Term("mutual power")))
    nothing = (0.0,) * 4
    questions = (
        least((0.0, -1.0, 0.0, 0.0), 3.2),
        Question("apart", (1.0, -0.0, -2.0, 1.0), nothing, (0.0, 6.0, 0.0, 0.0), 20.0, 2.0, "apart"),
        Question("which", nothing, nothing, nothing, 0.0, 0.0, "which", options=("wind", "mutual power")),
    )
    record = record_of(structure, draw_constants(structure, random.Random(1)), questions)
    task, pack = task_of(record), pack_of(record, None)
    for sentence in (
        "with a constant force in the direction (0, -1) held on it from then on",
        "How large must the force be at least,",
        "so that object_1 has come 3.2 m or more in that direction at that moment?",
        "held there until the clock shows 20 s",
        "How far apart are the middles of the pucks?",
        "1: one force everywhere; 2: the pucks draw or repel each other by a power of the distance",
        "Answer with a list of three numbers: A in N, B in m, C the number of a term.",
        "has not been moved there",
        "The limit is one of the length of the vector",
        "beyond the rim, after the laboratory's time",
    ):
        assert sentence in task
    assert "-0," not in task
    assert pack.answer_spec is not None
    assert pack.answer_spec.unit == ("N", "m", "1")
    assert "find_objects" in pack.disabled_tools


def candidates(*kinds: str) -> list[Question]:
    return [Question(kind, (0.0,), (0.0,), (0.0,), 0.0, 2.0, "u") for kind in kinds]


def parts(count: int, *affecting: set[int]) -> Flags:
    """Return which of `count` parts affect each candidate, shape (parts, candidates)."""
    return np.array([[part in affects for affects in affecting] for part in range(count)])


def test_three_questions_that_depend_on_every_part_are_found_although_none_has_the_most_parts() -> None:
    asked = candidates("strong", "strong", "far", "late")
    matter = parts(7, {0, 1, 2, 3}, {0, 1, 4}, {2, 3, 5}, {6})
    assert covering(asked, matter, np.full(4, 0.1), 3) == (1, 2, 3)


def test_of_sets_that_suffice_the_one_with_most_kinds_and_the_smallest_error_is_asked() -> None:
    asked = candidates("strong", "strong", "far", "far", "late")
    matter, spread = parts(1, *[{0}] * 5), np.array([0.01, 0.2, 0.3, 0.2, 0.1])
    assert covering(asked, matter, spread, 3) == (0, 3, 4)


@pytest.mark.parametrize("affecting", [[{0}, {0}, {0}], [{0, 1}, set(), {0}], [set(), set(), set()]])
def test_no_questions_are_asked_if_a_part_affects_none_or_too_few_depend_on_the_law(affecting: list[set[int]]) -> None:
    assert covering(candidates(*["strong"] * 3), parts(2, *affecting), np.full(3, 0.1), 3) is None
