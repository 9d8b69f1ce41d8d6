"""Tests that every part of the grammar gives the same motion in the engine and in numpy."""

import random

import numpy as np
import pytest

from evaluator.certify.worlds import course_gap, engine_answers
from scenes.worlds.acceptance import FORCE
from scenes.worlds.answering import answers
from scenes.worlds.catalogue import FORMS, MODULATIONS, forms_of, modulations_of
from scenes.worlds.drawing import draw_constant, draw_constants
from scenes.worlds.equations import followed, moved, rates_of
from scenes.worlds.experiment import Situation, simulated
from scenes.worlds.parts import Apparatus, Form, Modulation, Range
from scenes.worlds.questions import Question, tolerance
from scenes.worlds.records import WorldRecord
from scenes.worlds.terms import Structure, Term

BRAKES = {True: "linear drag", False: "friction"}


def record_of(structure: Structure, questions: tuple[Question, ...] = (), seed: int = 1) -> WorldRecord:
    """A record of a world with random constants and few readings."""
    told = Situation(structure.apparatus, structure.radius, FORCE, 8, 0.002)
    return WorldRecord(
        grammar=1, level=1, index=0, split="train", salt="s", apparatus=structure.apparatus,
        terms=tuple((term.form, term.modulations) for term in structure.terms),
        constants=draw_constants(structure, random.Random(seed)), radius=told.radius, force=told.force,
        looks=told.looks, noise=told.noise, questions=questions,
    )  # fmt: skip


def apparatus_of(form: Form) -> Apparatus:
    """Return an apparatus that supports a form."""
    return next(
        apparatus
        for apparatus in (Apparatus.PUCK, Apparatus.PAIR, Apparatus.WHEEL, Apparatus.GLIDER)
        if form in forms_of(apparatus)
    )


def with_brake(form: Form, names: tuple[str, ...] = (), apparatus: Apparatus | None = None) -> Structure:
    """Return a structure with a form, and with a brake unless the form is one."""
    apparatus = apparatus or apparatus_of(form)
    brake = () if form.group == "drag" else (Term(BRAKES[apparatus.flat]),)
    return Structure(apparatus, (Term(form.name, names), *brake))


def test_there_are_as_many_parts_as_promised() -> None:
    assert len(FORMS) >= 24
    assert len(MODULATIONS) >= 12


@pytest.mark.parametrize("form", FORMS.values(), ids=lambda form: form.name)
def test_a_form_moves_bodies_in_the_engine_as_in_numpy(form: Form) -> None:
    assert course_gap(record_of(with_brake(form))) < 0.01


@pytest.mark.parametrize(
    "form", [form for form in FORMS.values() if form in forms_of(Apparatus.GLIDER)], ids=lambda f: f.name
)
def test_a_form_of_one_coordinate_moves_a_glider_too(form: Form) -> None:
    assert course_gap(record_of(with_brake(form, apparatus=Apparatus.GLIDER))) < 0.01


@pytest.mark.parametrize("part", MODULATIONS.values(), ids=lambda part: part.name)
def test_a_modulation_acts_in_the_engine_as_in_numpy(part: Modulation) -> None:
    apparatus = next(apparatus for apparatus in (Apparatus.PUCK, Apparatus.WHEEL) if part in modulations_of(apparatus))
    form = next(form for form in forms_of(apparatus) if form.group in part.fits)
    plain, modulated = with_brake(form), with_brake(form, (part.name,))
    assert course_gap(record_of(modulated)) < 0.01
    # The modulation changes the motion.
    one, other = record_of(plain, seed=3), record_of(modulated, seed=3)
    courses = [simulated(r.structure, r.constants, r.told, None).readings for r in (one, other)]
    assert np.abs(courses[0] - courses[1]).max() > 0.01


@pytest.mark.parametrize("name", [*FORMS, *MODULATIONS])
def test_one_trial_in_plain_numbers_moves_as_one_of_many(name: str) -> None:
    if name in FORMS:
        structure = with_brake(FORMS[name])
    else:
        part = MODULATIONS[name]
        apparatus = next(one for one in (Apparatus.PUCK, Apparatus.WHEEL) if part in modulations_of(one))
        form = next(form for form in forms_of(apparatus) if form.group in part.fits)
        structure = with_brake(form, (name,))
    rng = random.Random(name)
    constants = draw_constants(structure, rng)
    state = [rng.uniform(-2, 2) for _ in structure.states]
    controls = [rng.uniform(-5, 5) for _ in range(structure.controls)]
    one = followed(rates_of(structure, walled=True, single=True), constants, 0.7, state, controls, 0.9, 0.05)
    column = np.array([state, state]).T
    many = moved(rates_of(structure, walled=True), constants, 0.7, column, np.array([controls, controls]).T, 0.9, 0.05)
    assert many == pytest.approx(np.array([one, one]).T, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("form", ["responder", "wake", "drag cup", "mutual power", "sluggish", "drive"])
def test_questions_beyond_the_laboratory_are_answered_alike(form: str) -> None:
    structure = with_brake(FORMS[form], ("wear",) if form == "responder" else ())
    width = structure.controls
    place = tuple([1.2, -0.7, -2.0, 0.5][:width]) if structure.apparatus.flat else (0.8,)
    speed, push = (3.0,) * width, (6.0,) * width
    what = ("dx", "vy", "speed") if structure.apparatus.flat else ("dq", "u", "u")
    questions = tuple(
        Question("late", place, speed, push, clock, 1.5, number)
        for clock, number in zip((0.0, 12.0, 20.0), what, strict=True)
    )
    record = record_of(structure, questions)
    theory = answers(structure, record.constants, questions, 0.01)[:, 0]
    assert np.abs(engine_answers(record) - theory) == pytest.approx(np.zeros(3), abs=1e-2 * tolerance(theory).min())


def test_a_structure_without_a_part_keeps_the_constants_of_the_others() -> None:
    structure = Structure(Apparatus.PUCK, (Term("power drag", ("beat", "shelf")), Term("wind"), Term("centre power")))
    constants = draw_constants(structure, random.Random(5))
    assert structure.label == "puck: centre power; power drag * beat * shelf; wind"
    fewer, renamed = structure.without(0, None)
    kept = {new: value for name, value in constants.items() if (new := renamed(name)) is not None}
    assert set(kept) == set(fewer.ranges)
    assert kept["g1"] == constants["g2"]
    fewer, renamed = structure.without(1, 0)
    kept = {new: value for name, value in constants.items() if (new := renamed(name)) is not None}
    assert set(kept) == set(fewer.ranges)
    assert kept["k1m0"] == constants["k1m1"]


def test_terms_have_one_order_whatever_they_are_given_in() -> None:
    terms = (Term("wind"), Term("grain", ("fading",)))
    assert Structure(Apparatus.PUCK, terms) == Structure(Apparatus.PUCK, terms[::-1])


@pytest.mark.parametrize(
    ("bounds", "values", "distances"),
    [
        (Range(0.5, 2.0), [0.5, 2.0, 0.45, 2.3], [0, 0, 0.1, 0.2]),
        (Range(0.0, 4.0, "lin"), [0.0, -1.0, 6.0], [0, 0.25, 0.5]),
        (Range(0.2, 1.0, "sign"), [-0.5, 0.1, -0.1, 1.5], [0, 0.5, 0.5, 0.625]),
        (Range(0.0, 2.0, "disc"), [-1.0, 0.25, -2.3], [0, 0.5, 0.2]),
        (Range(0.2, 4.0, "ratio"), [0.3, 3.0, 1.0, 0.1], [0, 0, 0.9 / 1.9, 0.5]),
        (Range(0.0, 3.0, "angle"), [-50.0, 50.0], [0, 0]),
    ],
    ids=lambda value: value.scale if isinstance(value, Range) else "",
)
def test_the_distance_from_a_range_is_relative(bounds: Range, values: list[float], distances: list[float]) -> None:
    assert bounds.beyond(np.array(values)) == pytest.approx(distances)


def test_a_sampled_constant_is_in_its_range() -> None:
    rng = random.Random(3)
    ranges = [bounds for part in (*FORMS.values(), *MODULATIONS.values()) for bounds in part.constants.values()]
    assert {bounds.scale for bounds in ranges} == {"log", "lin", "sign", "disc", "ratio", "angle"}
    for bounds in ranges:
        assert bounds.beyond(np.array([draw_constant(bounds, rng) for _ in range(50)])).max() < 1e-5
