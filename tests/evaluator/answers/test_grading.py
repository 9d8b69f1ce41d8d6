"""Tests of the grader: an example for every rule, the difficult answers of the published suite, property tests."""

import json
import math
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import JsonValue

from evaluator.answers.grading import ZERO_ABS_TOL, grade, grade_episode, grade_missing, infer_spec, listed_numbers
from evaluator.answers.strict import AnswerKey
from evaluator.quantities.units import conversion, parse_unit
from evaluator.records.episode import NormalisationClass, Outcome, Verdict
from scenes.answer_spec import AnswerKind, AnswerSpec, Scalar
from tests.builders.keys import (
    CONCEPT,
    FORMAT,
    NOTATION,
    ROUNDING,
    STRICT,
    WRONG,
    Expected,
    choice,
    number,
    numbers,
    objects,
    published,
    text,
    verdict_of,
)
from tests.builders.records import episode


@dataclass(frozen=True)
class Case:
    name: str
    answer: JsonValue
    key: AnswerKey
    expected: Expected
    graded: float | None = None


def check(case: Case) -> None:
    assert verdict_of(case.answer, case.key) == case.expected
    if case.graded is not None:
        assert grade(case.answer, case.key).graded == pytest.approx(case.graded)


# The stress cases in section 3 of the audit of the published suite.
CARTS = {"object_1": "cart_1", "object_2": "cart_2"}
SECTION_3 = [
    Case("only a full stop", ".", published(0.889), WRONG),
    Case("part of a list", "2", published((2, 1.41), "oscillation"), WRONG),
    Case("zero for two zeros", "0", published((0, 0), "conceptual"), WRONG),
    Case("zero inside 0.72", "0", published(0.72), WRONG),
    Case("zero inside a list", "0", published((1, 0.2), "comparison"), WRONG),
    Case("key inside 12", "12", published(2, "comparison"), WRONG),
    Case("key inside 20", "20", published(2, "comparison"), WRONG),
    Case("key inside 2.9", "2.9", published(2, "comparison"), WRONG),
    Case("hedged set", "1, 2, 3", published(2, "comparison"), WRONG),
    Case("negation", "not 2", published(2, "comparison"), WRONG),
    Case("minus added", "-3.27", published(3.27), WRONG),
    Case("minus omitted", "4.905", published(-4.905, "computation"), WRONG),
    Case("0.81 is 12 % off 0.72", "0.81", published(0.72), WRONG),
    Case("0.6 is 17 % off 0.513", "0.6", published(0.513), WRONG),
    Case("0.29 is 45 % off 0.2", "0.29", published(0.2), WRONG),
    Case("joule where newton is asked", "150 J", number(150, "N"), WRONG),
    Case("joule where no unit is declared cannot be checked", "150 J", published(150), WRONG),
    Case("newton where newton is asked", "150 N", number(150, "N"), FORMAT),
    Case("elastic inside inelastic", "elastic", text("inelastic"), WRONG),
    Case("non-oscillatory contains oscillatory", "non-oscillatory", text("oscillatory"), WRONG),
    Case("2936.1 is 0.1 % off 2939.6", "2936.1", published(2939.6), STRICT),
    Case("149 is 0.7 % off 150", "149", published(150), STRICT),
    Case("26.5 is 0.6 % off 26.667", "26.5", published(26.667), STRICT),
    Case("30.5 is 0.5 % off 30.656", "30.5", published(30.656), STRICT),
    Case("63.2 is 0.3 % off 63.4", "63.2", published(63.4), STRICT),
    Case("a fraction", "1/2", published(0.5), FORMAT),
    Case("a number in words is in no documented class", "three", published(3, "comparison"), WRONG),
    Case("public name", "hollow_sphere", objects(2, object_1="solid_sphere", object_2="hollow_sphere"), NOTATION),
    Case(
        "public name, published pack", "hollow_sphere", published(2, "comparison", object_2="hollow_sphere"), NOTATION
    ),
    Case("order matters", "0.5, 2", published((2, 0.5)), WRONG, graded=0),
    Case("empty for 0", "", published(0), WRONG),
    Case("empty for 2", "", published(2, "comparison"), WRONG),
]

# The answers in section 4.5 of the audit, with its numbers.
SIX_NUMBERS = (717.5, 2939.6, 146.3, 747.3, 3656.4, 149.3)
LEVER = r"setup 1 .*has more torque"
SECTION_4_5 = [
    Case("1 identical", "12.5", published(12.5), STRICT),
    Case("2 identical", "0.72", published(0.72), STRICT),
    Case("3 identical", "2.837", published(2.837), STRICT),
    Case("4 alias", "object_2", published(2, "comparison"), NOTATION),
    Case("5 alias", "cart_2", published(2, "momentum analysis", **CARTS), NOTATION),
    Case("6 alias", "disk_2", published(2, "observation", object_1="disk_1", object_2="disk_2"), NOTATION),
    Case(
        "7 id with its name",
        "object_1 (rolling_sphere)",
        published(1, "observation", object_1="rolling_sphere"),
        NOTATION,
    ),
    Case("8 prose without a pattern", "Setup 1 (Beam 1 with Weight 1) has more torque", published(1, "torque"), WRONG),
    Case(
        "8 prose the scene accepts",
        "Setup 1 (Beam 1 with Weight 1) has more torque",
        choice(1, accept=(LEVER,)),
        CONCEPT,
    ),
    Case("9 key is wrong in that pack, the grader follows it", "4", published(2, "observation"), WRONG),
    Case("10 one answer for two", "pendulum_1", published((1, 1.5), "oscillation", object_1="pendulum_1"), WRONG),
    Case("11 0.1 % off", "1.962", published(1.96), STRICT),
    Case("12 three numbers", "4.0, 4.0, 4.0", published((4, 4, 4), "computation"), STRICT),
    Case(
        "13 labelled, with units",
        "Velocity magnitude: 4.000 m/s, Displacement: 4.000 m, Work: 4.0 J",
        numbers(4, 4, 4, unit=("m/s", "m", "J")),
        FORMAT,
    ),
    Case(
        "13 units that nothing declares",
        "Velocity magnitude: 4.000 m/s, Displacement: 4.000 m, Work: 4.0 J",
        published((4, 4, 4), "computation"),
        WRONG,
    ),
    Case("14 two signs", "717.5, 2936.1, -146.3, 747.3, 3652.7, -149.3", published(SIX_NUMBERS), WRONG, graded=4 / 6),
    Case("15 1.1 % off", "5, 9.886, 5, 9.886", published((5, 10, 5, 10), "computation"), STRICT),
    Case("16 near the engine, far from the key", "3.3, 42.0", published((20.2, 62.8), "computation"), WRONG, graded=0),
    Case("17 nonsense for a choice", "1.0245", published(2, "observation"), WRONG),
    Case("18 hedge", "1,4", published(1, "comparison"), WRONG),
    Case("19 hedge", "2,3", published(3, "comparison"), WRONG),
    Case("20 hedge", "1,3", published(3, "comparison"), WRONG),
    Case("21 vector for a scalar, not zero", "0, 156.96, 0", published(0), WRONG),
    Case("22 vector for a scalar, zero", "[0.000, 0.000, 0.000]", published(0), WRONG),
    Case("23 far off", "3.963", published(22.9), WRONG),
    Case("24 far off", "9.81", published(3.89), WRONG),
    Case("25 14 % off", "0.587", published(0.513), WRONG),
    Case("26 sign", "-1.962", published(1.96), WRONG),
    Case("27 vector for a scalar", "0.0,0.0,-4.905", published(-4.905, "computation"), WRONG),
    Case("27 the same with spaces", "0, 0, -4.905", published(-4.905, "computation"), WRONG),
    Case("28 sign", "4.905", published(-4.905, "computation"), WRONG),
    Case("29 no option of that pack", "non-oscillatory", published(1, "classification"), WRONG),
    Case("30 no option of that pack", "elastic", published(2, "classification"), WRONG),
    Case("30 the other option", "elastic", choice("inelastic", "elastic", "inelastic"), WRONG),
    Case("31 key is wrong in that pack, the grader follows it", "2.0", published(3, "balance"), WRONG),
    Case("32 vector for a choice", "0.6, 0.1, 1.5", published(2, "observation"), WRONG),
    Case("80: the engine says 2, the grader follows the key", "2", published(3, "comparison"), WRONG),
    Case("57 twice the key", "9.81", published(4.91, "friction"), WRONG),
    Case("52 word for a number", "clockwise", published(2, "rotational equilibrium"), WRONG),
    Case("51 two of three", "26.16, 2", published((2, 3.27, 26.16), "tension"), WRONG),
    Case("17 prose", "No, different masses do not affect the acceleration", published(3, "conceptual"), WRONG),
    Case("49 spelling of 0.0", "0, 2", published((0.0, 2.0), "linear momentum"), STRICT),
]

FORMS = [
    Case("JSON number", 4.905, number(4.905), STRICT),
    Case("padded string", "  4.905 ", number(4.905), STRICT),
    Case("exponent", "4.905e0", number(4.905), STRICT),
    Case("plus sign", "+4.905", number(4.905), STRICT),
    Case("exactly on the bound", "0.756", number(0.72), STRICT),
    Case("exactly on the lower bound", 0.684, number(0.72), STRICT),
    Case("just outside the bound", "0.7560001", number(0.72), WRONG),
    Case("absolute tolerance for zero", 0.009, published(0), STRICT),
    Case("zero with the default tolerance", 1e-9, number(0), STRICT),
    Case("unit", "4.905 m/s", number(4.905, "m/s"), FORMAT),
    Case("unit stuck to the number", "4.905m/s", number(4.905, "m/s"), FORMAT),
    Case("converted length", "49 cm", number(0.49, "m"), FORMAT),
    Case("converted mass", "2500 g", number(2.5, "kg"), FORMAT),
    Case("converted energy", "0.15 kJ", number(150, "J"), FORMAT),
    Case("converted speed", "36 km/h", number(10, "m/s"), FORMAT),
    Case("converted angle", "180 degrees", number(math.pi, "rad"), FORMAT),
    Case("converted angle sign", "57.3°", number(1, "rad"), FORMAT),
    Case("converted rate", "60 rpm", number(6.283, "rad/s"), FORMAT),
    Case("hertz is not radians per second", "3 Hz", number(3, "rad/s"), WRONG),
    Case("per cent", "50 %", number(0.5, "1"), FORMAT),
    Case("degrees for a bare number", "0.5 deg", number(0.5, "1"), WRONG),
    Case("right number, other unit of the same kind", "0.49 cm", number(0.49, "m"), WRONG),
    Case("unit in words", "9.81 metres per second squared", number(9.81, "m/s^2"), FORMAT),
    Case("unit with superscripts", "9.81 m·s⁻²", number(9.81, "m/s^2"), FORMAT),
    Case("unit with trailing direction", "4.905 m/s downward", number(4.905, "m/s"), WRONG),
    Case("label", "v = 4.905 m/s", number(4.905, "m/s"), FORMAT),
    Case("sentence", "The final answer is 4.905.", number(4.905, "m/s"), FORMAT),
    Case(
        "label of the scene",
        "apex: 3.26",
        AnswerKey(3.26, AnswerSpec(kind=AnswerKind.NUMBER, labels=("apex",))),
        FORMAT,
    ),
    Case("label that negates", "anything but = 4.905", number(4.905), WRONG),
    Case("negation after a label", "The answer is not 4.905", number(4.905), WRONG),
    Case("bound", "> 4.905", number(4.905), WRONG),
    Case("uncertainty", "4.905 ± 5", number(4.905), WRONG),
    Case("range", "4.8-5.0", number(4.905), WRONG),
    Case("alternatives", "4.905 or 9.81", number(4.905), WRONG),
    Case("about", "about 4.9", number(4.905), FORMAT),
    Case("brackets", "(4.905)", number(4.905), FORMAT),
    Case("one-element list", [4.905], number(4.905), FORMAT),
    Case("one-element list as text", "[4.905]", number(4.905), FORMAT),
    Case("two-element list", [4.905, 4.905], number(4.905), WRONG),
    Case("LaTeX", r"$\boxed{4.905\,\text{m/s}}$", number(4.905, "m/s"), FORMAT),
    Case("LaTeX fraction", r"\frac{1}{2}", number(0.5), FORMAT),
    Case("LaTeX unit", r"4.905\,\frac{m}{s^{2}}", number(4.905, "m/s^2"), FORMAT),
    Case("mixed number", r"3\frac{1}{2}", number(3.5), WRONG),
    Case("LaTeX power", r"1.2 \times 10^{3}", number(1200), FORMAT),
    Case("power of ten", "1.2×10^3 N", number(1200, "N"), FORMAT),
    Case("superscript power", "1.2·10⁻³", number(0.0012), FORMAT),
    Case("negative power", "-10^2", number(-100), FORMAT),
    Case("fraction of zero", "1/0", number(1), WRONG),
    Case("thousands", "2,939.6 J", number(2939.6, "J"), FORMAT),
    Case("thousands with spaces", "12 000", number(12000), FORMAT),
    Case("decimal comma is not guessed", "4,905", number(4.905), WRONG),
    Case("unicode minus", "−4.905", number(-4.905), FORMAT),
    Case("two numbers", "4.905 4.905", number(4.905), WRONG),
    Case("trailing one is not a unit", "5 1", number(5, "1"), WRONG),
    Case("infinity", "Infinity", number(4.905), WRONG),
    Case("not a number", "nan", number(4.905), WRONG),
    Case("JSON infinity", math.inf, number(4.905), WRONG),
    Case("overflow", "1e999", number(4.905), WRONG),
    Case("underscored digits", "4_905", number(4905), WRONG),
    Case("other digits", "٤", number(4), WRONG),
    Case("true is not 1", True, number(1), WRONG),
    Case("true in a list is not 1", [True, 2], numbers(1, 2), WRONG),
    Case("null", None, number(1), WRONG),
    Case("object", {"answer": 1}, number(1), WRONG),
    Case("huge integer", 10**5000, number(1), WRONG),
    Case("rounded to two digits", "0.12", number(0.1249, rel_tol=0.01), ROUNDING),
    Case("rounded to one digit", "0.1", number(0.1249, rel_tol=0.01), WRONG),
    Case("rounded the wrong way", "0.13", number(0.1249, rel_tol=0.01), WRONG),
    Case("rounded JSON number", 0.12, number(0.1249, rel_tol=0.01), ROUNDING),
    Case("rounding and unit do not stack", "0.12 m", number(0.1249, "m", rel_tol=0.01), WRONG),
    Case("JSON list", [3.3, 42.0], numbers(3.3, 42), STRICT),
    Case("JSON list of strings", ["3.3", "42"], numbers(3.3, 42), STRICT),
    Case("list as text", "[3.3, 42]", numbers(3.3, 42), STRICT),
    Case("half right", [3.3, 7], numbers(3.3, 42), WRONG, graded=0.5),
    Case("list that is too long", [3.3, 42, 1], numbers(3.3, 42), WRONG, graded=0),
    Case("nested list", [[3.3, 42]], numbers(3.3, 42), FORMAT, graded=0),
    Case("two lists", [[3.3], [42]], numbers(3.3, 42), WRONG),
    Case("list and number", [[3.3, 42], 3.3], numbers(3.3, 42), WRONG),
    Case("lists in a text", "[[3.3], [42]]", numbers(3.3, 42), WRONG),
    Case("common unit", "(3.3, 42.0) m/s", numbers(3.3, 42, unit="m/s"), FORMAT),
    Case("and", "3.3 m/s and 42.0 m/s", numbers(3.3, 42, unit="m/s"), FORMAT),
    Case("lines", "v = 3.3\nh = 42", numbers(3.3, 42), FORMAT),
    Case("one part forgiven", ["3.3 m", 42], numbers(3.3, 42, unit="m"), FORMAT, graded=0.5),
    Case("labels swapped", "height = 3.3, speed = 42", numbers(3.3, 42, labels=("speed", "height")), WRONG),
    Case("labels right", "speed = 3.3, height = 42", numbers(3.3, 42, labels=("speed", "height")), FORMAT),
    Case("trailing comma", "3.3,", numbers(3.3, 42), WRONG),
    Case("id and number", ["object_2", 3.3], numbers("object_2", 3.3), STRICT),
    Case("id by number, and number", [2, 3.3], numbers("object_2", 3.3), NOTATION, graded=0.5),
    Case("choice", " Clockwise ", choice("clockwise", "clockwise", "still"), STRICT),
    Case("choice with a label", "Answer: clockwise.", choice("clockwise", "clockwise", "still"), FORMAT),
    Case("whole JSON float for a choice", 2.0, choice(2, "1", "2"), STRICT),
    Case("2.0 as text for a choice", "2.0", choice(2, "1", "2"), FORMAT),
    Case("id where a numbered option is asked", "object_2", choice(2, "1", "2"), WRONG),
    Case("id as asked", "object_2", objects("object_2", **CARTS), STRICT),
    Case("id as asked, key by number", "object_2", objects(2, **CARTS), STRICT),
    Case("number, key by id", 2, objects("object_2", **CARTS), NOTATION),
    Case("negative number, key by id", "-2", objects("object_2", **CARTS), WRONG),
    Case("negative number, typeset", " \N{MINUS SIGN}2", objects("object_2", **CARTS), WRONG),
    Case("id with a space", "Object 2", objects("object_2", **CARTS), NOTATION),
    Case("id in a list of one", ["2"], objects("object_2", **CARTS), NOTATION),
    Case("name of another object", "cart_1", objects("object_2", **CARTS), WRONG),
    Case("id with the name of another object", "object_2 (cart_1)", objects("object_2", **CARTS), WRONG),
    Case("two ids", "object_1 or object_2", objects("object_2", **CARTS), WRONG),
    Case("equation of ids", "object_1 = object_2", objects("object_2", **CARTS), WRONG),
    Case("name shared by two objects", "cart", objects("object_2", object_1="cart", object_2="cart"), WRONG),
    Case("zero means none of the objects", 0, objects("0", **CARTS), STRICT),
    Case("order of ids", "object_2, object_1", objects(("object_2", "object_1"), **CARTS), STRICT),
    Case("order of ids wrong", "object_1, object_2", objects(("object_2", "object_1"), **CARTS), WRONG, graded=0),
    Case("order by numbers", "2, 1", objects(("object_2", "object_1"), **CARTS), NOTATION),
    Case("whole words of the key", "rolls faster", text("the shell rolls faster"), STRICT),
    Case("the key itself", "No.", text("no."), STRICT),
    Case("only function words", "the", text("the shell rolls faster"), WRONG),
    Case("words that are not contiguous", "shell faster", text("the shell rolls faster"), WRONG),
    Case("part of a word", "fast", text("the shell rolls faster"), WRONG),
    Case("longer than the key", "the shell rolls faster than the disk", text("the shell rolls faster"), WRONG),
    Case("negation left out", "oscillates", text("it no longer oscillates"), WRONG),
    Case("number left out", "ball", text("ball 2"), WRONG),
    Case("also in another option", "ball", text("the red ball", "the red ball", "the blue ball"), WRONG),
    Case("only in this option", "red ball", text("the red ball", "the red ball", "the blue ball"), STRICT),
    Case("punctuation", "?!", text("it slides"), WRONG),
    Case("decorated words", '"it slides".', text("it slides"), STRICT),
    Case("accepted wording", "They tie", choice(0, accept=(r"(they )?tie",)), CONCEPT),
    Case("accepted wording inside more", "They tie or object_1 wins", choice(0, accept=(r"(they )?tie",)), WRONG),
    Case("too long to match a pattern", "a" * 400, choice(0, accept=("a+",)), WRONG),
    Case("too long to read", "2" + " " * 2000, choice(2), WRONG),
    Case("too long inside a list", [["2" + " " * 2000]], choice(2), WRONG),
    Case("too long inside an object", {"speed": "2" + " " * 2000}, numbers(2, labels=("speed",)), WRONG),
    Case("beyond all floats", "9" * 400 + " m", number(1, "m"), WRONG),
    Case("lone surrogate", "\ud800", number(1), WRONG),
]


@pytest.mark.parametrize("case", SECTION_3, ids=lambda case: case.name)
def test_answers_that_the_published_matcher_misjudged_get_the_right_verdict(case: Case) -> None:
    check(case)


@pytest.mark.parametrize("case", SECTION_4_5, ids=lambda case: case.name)
def test_answers_from_the_published_logs_get_the_right_verdict(case: Case) -> None:
    check(case)


@pytest.mark.parametrize("case", FORMS, ids=lambda case: case.name)
def test_every_form_of_an_answer_gets_the_right_verdict(case: Case) -> None:
    check(case)


@pytest.mark.parametrize(
    ("written", "asked", "factor"),
    [
        *(("cm", "m", 0.01), ("km/h", "m/s", 1 / 3.6), ("kJ", "J", 1000), ("g", "kg", 0.001), ("ms", "s", 0.001)),
        *(("deg", "rad", math.pi / 180), ("rad", "degrees", 180 / math.pi), ("Hz", "rad/s", 2 * math.pi)),
        *(("rpm", "rad/s", math.pi / 30), ("1/s", "Hz", 1), ("/s", "Hz", 1), ("s^-1", "rad/s", 1), ("rad", "1", 1)),
        *(
            ("N m", "N·m", 1),
            ("Nm", "J", 1),
            ("newton-metres", "N*m", 1),
            ("N/(m/s)", "kg/s", 1),
            ("J s", "kg·m²/s", 1),
        ),
        *(("m/s/s", "m/s²", 1), ("m s⁻²", "m/s^2", 1), ("metres per second squared", "m/s^2", 1), ("%", "1", 0.01)),
        *(("square metres", "m^2", 1), ("cubic centimetres", "m^3", 1e-6), ("g/L", "kg/m^3", 1), ("N·m/rad", "N·m", 1)),
        *(("J", "N", None), ("cat", "m", None), ("m//s", "m/s", None), ("(m", "m", None), ("m)", "m", None)),
        *(
            ("m 1", "m", None),
            ("N·m/deg", "N·m", None),
            ("deg", "1", None),
            ("rad^2", "rad", None),
            ("m" * 80, "m", None),
        ),
        *(("", "m", None), ("m/", "m", None), ("m §", "m", None)),
    ],
)
def test_units_convert_only_if_they_measure_the_same_quantity(written: str, asked: str, factor: float | None) -> None:
    source, target = parse_unit(written), parse_unit(asked)
    found = None if source is None or target is None else conversion(source, target)
    assert found == (None if factor is None else pytest.approx(factor))


# Constant answers against all keys of the published suite.
CHOICES = {
    0: "22",
    1: "12 14 18 24 26 27 31 39 43 45 47 53 56 62 64 69 71 75 77 83 84",
    2: "7 8 13 15 16 21 25 33 44 46 52 55 60 61 63 65 66 67 68 70 72b 73 74 76 79 81",
    3: "11 17 19 58 78 80 82",
}
QUANTITIES = (
    *(3.27, 22.9, -4.905, 1, -4.905, 1.96, 0, 0.889, 2.006, 2.219, 63.4, 20.2, 9.81, 0, 0.9, 0.8, 0.4, 4.91, 4.429),
    *(3.193, 10, 16.699, 2.837, 0.524, 0.513, 12.5, 3.206, 0.2, 26.667, 30.656, 3.89, 150, 0.72),
)
LISTS: tuple[tuple[Scalar, ...], ...] = (
    *(
        (20.2, 62.8),
        (12.6, 25.2, 18.9, 56.7),
        (1, 1),
        SIX_NUMBERS,
        (4, 4, 4),
        (1, 0.6, 0, 1, 0.6, 0, 1),
        (5, 10, 5, 10),
    ),
    *((4, 79.6, 6, 179), (0, 0), (2, 0.5), (2, 3), (0.0, 2.0), (2, 1.41), (2, 3.27, 26.16), (2, 1), (1, 10), (1, 1.5)),
    (1, 0.2),
)
SUITE = [
    *(published(value, "comparison") for value, ids in CHOICES.items() for _ in ids.split()),
    *(published(value) for value in QUANTITIES),
    *(published(values, "computation") for values in LISTS),
]


@pytest.mark.parametrize(
    "constant", [".", ",", "-", "0 1 2 3", "0, 1, 2, 3", "0 or 1 or 2", "e", "object_", "[]", "1e", "%"]
)
def test_a_constant_without_one_clear_value_is_never_right(constant: str) -> None:
    assert {verdict_of(constant, key) for key in SUITE} == {WRONG}


@pytest.mark.parametrize(("constant", "most"), [("0", 3), ("1", 22), ("2", 28), ("3", 7)])
def test_a_constant_digit_is_right_only_if_it_is_the_key(constant: str, most: int) -> None:
    right = [key.value for key in SUITE if verdict_of(constant, key) != WRONG]
    assert len(right) <= most
    assert all(isinstance(value, (int, float)) and abs(value - int(constant)) <= 0.05 * abs(value) for value in right)


APART = [sign * 0.03 * 1.2**power for power in range(40) for sign in (1, -1)]
"""Keys whose tolerance bands of 5 % do not overlap."""
SNIPPETS = st.lists(
    st.sampled_from(
        [
            *"0123456789.,-+/eEx*^=:;()[]{}$% ",
            "or",
            "and",
            "not",
            "±",
            "×10",
            "½",
            " 1/2",
            "７",
            "mph",
            "lb",
            "\\SI{",
            "#",
            "case ",
            "th",
            "m",
            "cm",
            "s",
            "kg",
            "N",
            "\\frac",
            "v",
            "\n",
        ]
    ),
    max_size=12,
).map("".join)


@settings(max_examples=200)
@given(constant=SNIPPETS, unit=st.sampled_from([None, "1", "m", "N", "m/s"]))
def test_no_text_is_right_for_two_different_keys(constant: str, unit: str | None) -> None:
    right = [value for value in APART if verdict_of(constant, number(value, unit)) != WRONG]
    assert len(right) <= 1


@settings(max_examples=100)
@given(constant=SNIPPETS)
def test_no_text_names_two_objects(constant: str) -> None:
    names = {f"object_{n}": f"block_{n}" for n in range(1, 10)}
    assert sum(verdict_of(constant, objects(object_id, **names)) != WRONG for object_id in names) <= 1


# Property tests.
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=40) | SNIPPETS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)
KEYS = [
    number(3.27, "m"),
    number(0),
    numbers(1, 2, unit=("m", "1")),
    numbers("object_1", 2.5),
    objects("object_2", **CARTS),
    objects(("object_2", "object_1")),
    choice(2),
    choice("still", "still", "moving", accept=("at rest",)),
    text("the shell rolls faster", "the shell rolls faster", "neither"),
]
SIZES = st.floats(min_value=1e-4, max_value=1e6, allow_subnormal=False)
SIGNED = st.builds(math.copysign, SIZES, st.sampled_from([1.0, -1.0]))


@settings(max_examples=200)
@given(answer=JSON, key=st.sampled_from(KEYS))
def test_grade_never_raises_and_its_verdicts_are_consistent(answer: JsonValue, key: AnswerKey) -> None:
    result = grade(answer, key)
    assert result.graded is not None
    assert 0 <= result.graded <= 1
    assert (result.strict is Verdict.CORRECT) <= (result.graded == 1)
    assert (result.strict is Verdict.CORRECT) <= (result.normalised is Verdict.CORRECT)
    assert (result.normalisation is not None) == (result.strict is not result.normalised)


@settings(max_examples=100)
@given(value=SIGNED)
def test_the_exact_key_is_strictly_right_in_every_plain_notation(value: float) -> None:
    key = number(value, "m")
    for answer in (value, repr(value), f" {value!r}\n", f"{value:.12e}", f"{value:+.8f}", f"{value:.6g}"):
        assert verdict_of(answer, key) == STRICT


@settings(max_examples=100)
@given(value=SIGNED)
def test_the_exact_key_is_forgiven_in_every_common_notation(value: float) -> None:
    key = number(value, "m")
    mantissa, exponent = f"{value:.9e}".split("e")
    plain = f"{value:.8f}"
    answers: list[JsonValue] = [
        f"{plain} m",
        f"{value * 100:.8f} cm",
        f"x = {plain} m",
        f"({plain})",
        [
            plain,
        ],
        f"**{plain}**",
        f"${plain}\\,\\mathrm{{m}}$",
        f"{mantissa}×10^{int(exponent)}",
        f"${mantissa} \\times 10^{{{int(exponent)}}}$ m",
        plain.replace("-", "−") + " metres",
        f"{value:,.6f} m",
        f"The answer is {plain}.",
    ]
    for answer in answers:
        assert verdict_of(answer, key) == FORMAT, answer


@settings(max_examples=200)
@given(value=SIGNED, off=st.floats(min_value=0.0501, max_value=10), side=st.sampled_from([1, -1]))
def test_an_answer_outside_the_tolerance_is_wrong(value: float, off: float, side: int) -> None:
    answer = value * (1 + side * off)
    assert verdict_of(answer, number(value)) == WRONG
    assert verdict_of(f"x = {answer!r} m", number(value, "m")) == WRONG


@settings(max_examples=100)
@given(value=SIGNED)
def test_a_flipped_sign_is_wrong(value: float) -> None:
    answers: list[JsonValue] = [-value, repr(-value), f"{-value!r} m", [-value]]
    for answer in answers:
        assert verdict_of(answer, number(value, "m")) == WRONG


@settings(max_examples=100)
@given(values=st.lists(st.sampled_from(APART), min_size=2, max_size=5, unique=True), data=st.data())
def test_a_list_is_right_only_in_the_order_of_the_key(values: list[float], data: st.DataObject) -> None:
    key = numbers(*values)
    moved = data.draw(st.permutations(values))
    for form in (list[JsonValue](moved), json.dumps(moved), ", ".join(map(str, moved))):
        assert verdict_of(form, key) == (STRICT if moved == values else WRONG)
        share = sum(got == wanted for got, wanted in zip(moved, values, strict=True)) / len(values)
        assert grade(form, key).graded == pytest.approx(share)


@settings(max_examples=100)
@given(values=st.lists(SIGNED, min_size=2, max_size=5), extra=SIGNED)
def test_a_list_of_the_wrong_length_is_wrong(values: list[float], extra: float) -> None:
    for answer in ([*values, extra], values[:-1], values[0]):
        result = grade(list[JsonValue](answer) if isinstance(answer, list) else answer, numbers(*values))
        assert (result.strict, result.normalised, result.graded) == (Verdict.INCORRECT, Verdict.INCORRECT, 0)


# Episodes without an answer.
@pytest.mark.parametrize("outcome", [Outcome.BUDGET_EXHAUSTED, Outcome.AGENT_ERROR])
def test_an_episode_without_an_answer_is_incorrect(outcome: Outcome) -> None:
    result = grade_missing(outcome)
    assert (result.strict, result.graded, result.normalised) == (Verdict.INCORRECT, 0.0, Verdict.INCORRECT)
    assert outcome.value in result.reason


def test_an_infrastructure_error_is_not_scored() -> None:
    result = grade_missing(Outcome.INFRASTRUCTURE_ERROR)
    assert (result.strict, result.graded, result.normalised) == (Verdict.UNSCORED, None, Verdict.UNSCORED)


def test_an_answered_episode_cannot_be_graded_as_unanswered() -> None:
    with pytest.raises(ValueError, match="graded by its answer"):
        grade_missing(Outcome.ANSWERED)


@pytest.mark.parametrize(
    ("outcome", "answer", "expected"),
    [
        (Outcome.ANSWERED, "3.27", Verdict.CORRECT),
        (Outcome.ANSWERED, None, Verdict.INCORRECT),
        (Outcome.BUDGET_EXHAUSTED, None, Verdict.INCORRECT),
        (Outcome.INFRASTRUCTURE_ERROR, None, Verdict.UNSCORED),
    ],
)
def test_an_episode_is_graded_by_its_answer_or_outcome(outcome: Outcome, answer: JsonValue, expected: Verdict) -> None:
    assert grade_episode(episode(outcome=outcome, answer=answer), number(3.27)).strict is expected


# Answer keys.
@pytest.mark.parametrize(
    ("published_key", "read"),
    [
        ("4.0, 79.6", ("4.0", "79.6")),
        ("[1, 0.2]", ("1", "0.2")),
        ("it slides, then stops", "it slides, then stops"),
        ("4.0", "4.0"),
        (4.0, 4.0),
        ((1, 2), (1, 2)),
    ],
)
def test_a_published_key_with_numbers_in_one_string_is_a_list(published_key: Any, read: Any) -> None:
    assert listed_numbers(published_key) == read


@pytest.mark.parametrize(
    ("answer", "problem_type", "kind", "abs_tol"),
    [
        (3.27, "calculation", AnswerKind.NUMBER, 0),
        (150, "calculation", AnswerKind.NUMBER, 0),
        (1, "Computation", AnswerKind.NUMBER, 0),
        (0, "calculation", AnswerKind.NUMBER, ZERO_ABS_TOL),
        (2, "comparison", AnswerKind.CHOICE, 0),
        (0, "comparison", AnswerKind.CHOICE, 0),
        ("2", "observation", AnswerKind.CHOICE, 0),
        ("3.27", "calculation", AnswerKind.NUMBER, 0),
        (2.0, "friction", AnswerKind.NUMBER, 0),
        ((2, 1.41), "oscillation", AnswerKind.NUMBERS, 0),
        ((0, 0), "conceptual", AnswerKind.NUMBERS, ZERO_ABS_TOL),
        (("object_1", 2.5), "comparison", AnswerKind.NUMBERS, 0),
        ("object_2", "comparison", AnswerKind.OBJECTS, 0),
        (("object_2", "object_1"), "comparison", AnswerKind.OBJECTS, 0),
        (("up", "down"), "observation", AnswerKind.CHOICE, 0),
        (("up", 2.5), "observation", AnswerKind.CHOICE, 0),
        ("it tips over", "observation", AnswerKind.TEXT, 0),
    ],
)
def test_the_answer_type_of_a_published_key_is_inferred(
    answer: Scalar | tuple[Scalar, ...], problem_type: str, kind: AnswerKind, abs_tol: float
) -> None:
    spec = infer_spec(answer, problem_type)
    assert (spec.kind, spec.abs_tol, spec.rel_tol) == (kind, abs_tol, 0.05)


@pytest.mark.parametrize(
    ("value", "spec"),
    [
        ((), AnswerSpec(kind=AnswerKind.NUMBERS)),
        ((1, 2), AnswerSpec(kind=AnswerKind.NUMBER)),
        (("a", "b"), AnswerSpec(kind=AnswerKind.TEXT)),
        ("three", AnswerSpec(kind=AnswerKind.NUMBER)),
        (math.nan, AnswerSpec(kind=AnswerKind.NUMBER)),
        (True, AnswerSpec(kind=AnswerKind.NUMBER)),
        (" ", AnswerSpec(kind=AnswerKind.TEXT)),
        ("about 8", AnswerSpec(kind=AnswerKind.NUMBER, unit="m")),
        ((1, 2), AnswerSpec(kind=AnswerKind.NUMBERS, unit=("m",))),
        ((3.2, "x"), AnswerSpec(kind=AnswerKind.NUMBERS)),
        ((3.2, True), AnswerSpec(kind=AnswerKind.NUMBERS)),
        ((3.2,), AnswerSpec(kind=AnswerKind.NUMBERS, labels=("speed", "height"))),
        ((3.2, 1, 2), AnswerSpec(kind=AnswerKind.NUMBERS, labels=("speed", "height"))),
        (3.2, AnswerSpec(kind=AnswerKind.NUMBERS)),
        (1, AnswerSpec(kind=AnswerKind.CHOICE, accept=("(",))),
    ],
)
def test_a_key_that_no_answer_can_match_is_refused(value: Scalar | tuple[Scalar, ...], spec: AnswerSpec) -> None:
    with pytest.raises(ValueError, match=r"."):
        AnswerKey(value, spec)


@pytest.mark.parametrize(
    ("answer", "value", "forgiven"),
    [
        ("0.3", 0.28, True),
        (0.3, 0.28, True),
        ("1.0", 1.05, False),  # strictly right
        ("0.3", 0.26, False),  # rounded, but more than twice the tolerance off
        ("3", 3.2, False),  # a small whole number may be a guess
        ("0.4", 0.36, False),
        ("0.2", 0.28, False),  # wrongly rounded
    ],
)
def test_a_key_rounded_to_the_digits_written_is_forgiven(answer: JsonValue, value: float, *, forgiven: bool) -> None:
    found = grade(answer, AnswerKey(value, AnswerSpec(kind=AnswerKind.NUMBER)))
    assert (found.normalisation is NormalisationClass.TRIVIAL_ROUNDING) == forgiven


@pytest.mark.parametrize(("answer", "right"), [(0, True), (0.009, True), (-0.01, True), (0.011, False)])
def test_a_key_of_0_has_a_tolerance_of_its_own(answer: float, *, right: bool) -> None:
    found = grade(answer, AnswerKey(0, AnswerSpec(kind=AnswerKind.NUMBER)))
    assert (found.strict is Verdict.CORRECT) == right
    assert grade(0.001, AnswerKey(0, AnswerSpec(kind=AnswerKind.NUMBER, abs_tol=1e-4))).strict is Verdict.INCORRECT
