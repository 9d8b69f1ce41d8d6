"""Tests of notations that normalised grading accepts, similar texts that it rejects, and units of torque and energy."""

import json
import math
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import JsonValue

from evaluator.answers.strict import AnswerKey
from evaluator.quantities.units import conversion, parse_unit, same_quantity
from scenes.answer_spec import AnswerKind, AnswerSpec, Variable
from tests.builders.keys import (
    FORMAT,
    NOTATION,
    STRICT,
    WRONG,
    Expected,
    choice,
    number,
    numbers,
    objects,
    published,
    verdict_of,
)

FULL_WIDTH = str.maketrans("0123456789.-", "０１２３４５６７８９．－")


@pytest.mark.parametrize(
    ("answer", "value", "unit"),
    [
        ("7.85 mps", 7.85, "m/s"),
        ("17.56 mph", 7.85, "m/s"),
        ("25.75 ft/s", 7.85, "m/s"),
        ("5 lb", 2.268, "kg"),
        ("5 lbs", 2.268, "kg"),
        ("5 lbf", 22.24, "N"),
        ("2 kgf", 19.61, "N"),
        ("2 cal", 8.368, "J"),
        ("1.5 kcal", 6276, "J"),
        ("3 ft·lbf", 4.067, "N·m"),
        (r"\SI{7.85}{m/s}", 7.85, "m/s"),
        (r"$v = \qty{7.85}{m/s}$", 7.85, "m/s"),
        ("2½", 2.5, None),
        ("-2½ m", -2.5, "m"),
        ("½", 0.5, None),
        ("2 1/2", 2.5, None),
        ("−2 1/2 m", -2.5, "m"),
        ("１２．５", 12.5, None),
        ("－７．８５ m/s", -7.85, "m/s"),
        ("- angular-speed = 7.85", 7.85, None),
        ("(7.85,)", 7.85, None),
        ("[7.85,]", 7.85, None),
    ],
)
def test_a_common_notation_of_the_right_number_is_forgiven(answer: str, value: float, unit: str | None) -> None:
    assert verdict_of(answer, number(value, unit, rel_tol=0.001)) == FORMAT


@pytest.mark.parametrize(
    ("answer", "value", "unit"),
    [
        ("7.85 mph", 7.85, "m/s"),
        ("7.85 ft/s", 7.85, "m/s"),
        ("22.24 lb", 22.24, "N"),  # a pound is a mass
        ("5 lb", 22.24, "N"),
        ("5 lbf", 2.268, "kg"),
        ("2 kgf", 2, "kg"),
        ("2 Cal", 8.368, "J"),  # may be the calorie of food, which is a thousand times as large
        ("2 Cal", 8368, "J"),
        ("2 cal", 8.368, "N·m"),
        ("2, 1/2", 2.5, None),
        ("2 , 1/2", 2.5, None),
        ("2 1/2", 10.5, None),
        ("2 1/2", 1.0, None),  # 2 times 1/2
        ("21/2", 2.5, None),
        ("2 3/2", 3.5, None),
        ("2 1/2 1/2", 2.5, None),
        ("2.5 1/2", 3.0, None),
        ("1 250/300", 1.8333, None),  # 1250/300 with a thousands separator
        ("2½ or 3", 2.5, None),
        (r"2\frac{1}{2}", 2.5, None),  # some read it as a product
        (r"2 {\frac{1}{2}}", 2.5, None),
        (r"2\,\frac{1}{2}", 2.5, None),
        (r"\SI{7.85}{m/s}", 7.85, "m"),
        (r"\SI{7.85}{m/s} or 3", 7.85, "m/s"),
        (r"\SI{7.85}{3}", 7.85, None),
        ("7.85,", 7.85, None),
        ("(7.85, 3)", 7.85, None),
        ("(,7.85)", 7.85, None),
        ("7th", 7, None),
        ("case 7", 7, None),
        ("option 7", 7, None),
        ("#7", 7, None),
        ("-v = 7.85", 7.85, None),
        ("v-u = 7.85", 7.85, None),
    ],
)
def test_what_only_looks_like_a_notation_of_the_right_number_is_wrong(
    answer: str, value: float, unit: str | None
) -> None:
    assert verdict_of(answer, number(value, unit)) == WRONG


LABELLED = numbers(3.26, 16.6, unit=("m", "J"), labels=("greatest height", "kinetic energy"))
LETTERED = numbers(3.26, 16.6, unit=("m", "J"), labels=("A: greatest height", "B: kinetic energy"))


@pytest.mark.parametrize(
    ("answer", "key", "expected"),
    [
        ([[3.26, 16.6]], LABELLED, FORMAT),
        ([[[3.26, 16.6]]], LABELLED, FORMAT),
        ("[[3.26, 16.6]]", LABELLED, FORMAT),
        ({"greatest height": 3.26, "kinetic energy": 16.6}, LABELLED, FORMAT),
        ({"Kinetic_energy": "16.6 J", "greatest height": 3.26}, LABELLED, FORMAT),
        ('{"kinetic energy": 16.6, "greatest height": 3.26}', LABELLED, FORMAT),
        ({"A": 3.26, "B": 16.6}, LETTERED, FORMAT),
        ({"B": 16.6, "A: greatest height": 3.26}, LETTERED, FORMAT),
        (["3 13/50", 16.6], LABELLED, FORMAT),
        ([[16.6, 3.26]], LABELLED, WRONG),
        ([[3.26, 16.6], [3.26, 16.6]], LABELLED, WRONG),
        ({"greatest height": 16.6, "kinetic energy": 3.26}, LABELLED, WRONG),
        ({"greatest height": 3.26}, LABELLED, WRONG),
        ({"greatest height": 3.26, "kinetic energy": 16.6, "mass": 2}, LABELLED, WRONG),
        ({"height": 3.26, "kinetic energy": 16.6}, LABELLED, WRONG),
        ({"greatest height": 3.26, "kinetic energy": None}, LABELLED, WRONG),
        ({"greatest height": [3.26], "kinetic energy": 16.6}, LABELLED, WRONG),
        ('{"greatest height": 1, "greatest height": 3.26}', LABELLED, WRONG),
        ('{"greatest height": 3.26, "kinetic energy": 16.6, "kinetic energy": 99}', LABELLED, WRONG),
        ({"A": 3.26, "A: greatest height": 3.26}, LETTERED, WRONG),
        ({"3.26": 3.26, "16.6": 16.6}, numbers(3.26, 16.6), WRONG),
        ({"answer": 3.26}, number(3.26), WRONG),
        ('{"a": ' * 300, LABELLED, WRONG),
    ],
)
def test_lists_in_lists_and_objects_by_label(answer: JsonValue, key: AnswerKey, expected: Expected) -> None:
    assert verdict_of(answer, key) == expected


BAYS = choice(7, *map(str, range(1, 13)))
SIDES = choice(2, "0", "1", "2")


@pytest.mark.parametrize(
    ("answer", "key", "expected"),
    [
        ("case 7", BAYS, FORMAT),
        ("Option 7", BAYS, FORMAT),
        ("option #7", BAYS, FORMAT),
        ("#7", BAYS, FORMAT),
        ("7th", BAYS, FORMAT),
        ("the 7th", BAYS, FORMAT),
        ("12th", choice(12, *map(str, range(1, 13))), FORMAT),
        ("2nd", choice("2", "1", "2", "3"), FORMAT),
        ("case 2", published(2, "observation"), FORMAT),
        ("option 1", choice(1, "0", "1", "2"), FORMAT),
        ("case 17", BAYS, WRONG),
        ("case 7 or 8", BAYS, WRONG),
        ("not case 7", BAYS, WRONG),
        ("case -7", BAYS, WRONG),
        ("case 7.5", BAYS, WRONG),
        ("7rd", BAYS, WRONG),
        ("12nd", choice(12, *map(str, range(1, 13))), WRONG),
        ("17th", BAYS, WRONG),
        ("2nd", SIDES, WRONG),  # the second option is 1
        ("2nd", choice(1, "0", "1", "2"), WRONG),
        ("2nd", published(2, "observation"), WRONG),
        ("option 2", choice("they part", "they stay", "they part"), WRONG),
        ("#2", objects("object_2", object_1="cart", object_2="ball"), NOTATION),
        ("object #2", objects("object_2", object_1="cart", object_2="ball"), NOTATION),
        ("object_02", objects("object_2", object_1="cart", object_2="ball"), NOTATION),
        ("object_20", objects("object_2", object_1="cart", object_2="ball"), WRONG),
        ("object_002", objects("object_20", object_2="cart", object_20="ball"), WRONG),
        ("-#2", objects("object_2", object_1="cart", object_2="ball"), WRONG),
        ("2nd", objects("object_2", object_1="cart", object_2="ball"), WRONG),
        ("#1 or #2", objects("object_2", object_1="cart", object_2="ball"), WRONG),
        ("object_00", objects("0", object_1="cart"), WRONG),
    ],
)
def test_numbered_options_and_objects(answer: str, key: AnswerKey, expected: Expected) -> None:
    assert verdict_of(answer, key) == expected


def formula(text: str, *names: str) -> AnswerKey:
    variables = {name: Variable(meaning=name, unit="1", range=(1.1, 3.0)) for name in names}
    return AnswerKey(text, AnswerSpec(kind=AnswerKind.FORMULA, unit="N", variables=variables))


DRAG = formula("2*x*v^2", "x", "v")


@pytest.mark.parametrize(
    ("answer", "key", "expected"),
    [
        ("2 x v^2", DRAG, STRICT),
        ("F = 2*x*v^2", DRAG, FORMAT),
        ("2xv^2", DRAG, FORMAT),
        ("F(x, v) = 2xv²", DRAG, FORMAT),
        ("F_x = 2 x v^2", DRAG, FORMAT),
        ("The answer is 2 x v^2.", DRAG, FORMAT),
        (r"$F = 2 x \cdot v^{2}$", DRAG, FORMAT),
        (r"\frac{4 x v^2}{2}", DRAG, FORMAT),
        (["2xv^2"], DRAG, FORMAT),
        ("2vx^2", DRAG, WRONG),
        ("xv^2", DRAG, WRONG),
        ("F = 2xv", DRAG, WRONG),
        ("F = 2xv^2 = 8", DRAG, WRONG),
        ("F != 2xv^2", DRAG, WRONG),
        ("2 x v^2 *", DRAG, WRONG),
        ("**2 x v^2**", DRAG, FORMAT),
        ("-F = 2xv^2", DRAG, WRONG),
        ("- F = 2xv^2", DRAG, WRONG),
        ("1/F = 2xv^2", DRAG, WRONG),
        ("F^2 = 2xv^2", DRAG, WRONG),
        ("not = 2xv^2", DRAG, WRONG),
        ("2xv^2 or 3xv^2", DRAG, WRONG),
        ("x = 2 x v^2", DRAG, WRONG),  # an equation in the variables
        ("1/xv", formula("1/(x*v)", "x", "v"), WRONG),  # some read it as 1/x times v
        ("1/xv", formula("v/x", "x", "v"), WRONG),
        ("2^xv", formula("2^(x*v)", "x", "v"), WRONG),
        ("2^-xv", formula("2^(-x*v)", "x", "v"), WRONG),
        ("2xv", formula("2*xv", "x", "v", "xv"), STRICT),  # a variable of this name is meant
        ("2xv", formula("2*x*v", "x", "v", "xv"), WRONG),
        ("xvx", formula("x*v*x", "x", "v", "xv"), WRONG),  # xv x or x v x
        ("2pix", formula("2*pi*x", "x"), FORMAT),
        ("sin x", formula("sin(x)", "x"), WRONG),
        ("exp", formula("e*x*p", "e", "x", "p"), WRONG),
        (r"\frac{x+1}{2}", formula("x + 1/2", "x"), WRONG),
        (r"\frac{x+1}{2}", formula("(x + 1)/2", "x"), FORMAT),
        (r"\sqrt{x v}", formula("(x*v)^0.5", "x", "v"), FORMAT),
    ],
)
def test_a_formula_with_its_left_side_or_run_together(answer: Any, key: AnswerKey, expected: Expected) -> None:
    assert verdict_of(answer, key) == expected


# A torque is not an energy, although both have the dimensions of newton times metre.
@pytest.mark.parametrize(
    ("written", "asked", "same"),
    [
        ("J", "N·m", False),
        ("N·m", "J", False),
        ("kJ", "N*m", False),
        ("cal", "N·m", False),
        ("ft·lbf", "J", False),
        ("J/rad", "N·m", True),
        ("J/rad", "J", False),
        ("N·m·rad", "J", True),
        ("W·s", "J", True),
        ("W s", "N·m", False),
        ("kg·m²/s²", "J", True),
        ("kg·m²/s²", "N·m", True),
        ("N·m/rad", "N·m/rad", True),
        ("N·m/rad", "N·m", True),
        ("mN·m", "N·m", True),
        ("kN·m", "J", False),
        ("J·s", "kg·m²/s", True),
        ("N·m·s", "J·s", True),
        ("J/m", "N", True),
        ("N·m/s", "W", True),
        ("m", "s", False),
    ],
)
def test_units_of_torque_and_of_energy_are_told_apart(written: str, asked: str, *, same: bool) -> None:
    got, wanted = parse_unit(written), parse_unit(asked)
    assert got is not None
    assert wanted is not None
    assert same_quantity(got, wanted) is same
    factor = conversion(got, wanted)
    verdict = verdict_of(f"{3 / float(factor or 1)} {written}", number(3.0, asked))
    assert verdict == (FORMAT if same else WRONG)


UNITS = {
    "m/s": {"mps": 1.0, "mph": 0.44704, "ft/s": 0.3048},
    "N": {"lbf": 4.4482216, "kgf": 9.80665},
    "kg": {"lb": 0.45359237},
    "J": {"cal": 4.184},
}
HALVES = st.integers(min_value=1, max_value=500).map(lambda number: number + 0.5)
VALUES = HALVES | st.floats(min_value=0.5, max_value=500).map(lambda number: round(number, 3))


def notations(value: float, unit: str) -> list[JsonValue]:
    """Return other notations of a number."""
    text = f"{value:.9g}"
    forms: list[JsonValue] = [f"\\SI{{{text}}}{{{unit}}}", f"({text},)", text.translate(FULL_WIDTH) + f" {unit}"]
    forms += [f"{value / scale:.12g} {name}" for name, scale in UNITS[unit].items()]
    if value % 1 == 0.5:
        forms += [f"{int(value)}½ {unit}", f"{int(value)} 1/2"]
    return forms


@settings(max_examples=200)
@given(
    value=VALUES,
    unit=st.sampled_from(sorted(UNITS)),
    off=st.sampled_from([0.0, 0.03, -0.03, 0.06, -0.06, 1.0, -0.5]) | st.floats(min_value=-0.9, max_value=9),
)
def test_a_notation_of_a_value_is_right_exactly_if_the_value_is(value: float, unit: str, off: float) -> None:
    wanted = value * (1 + off)
    assume(abs(abs(value - wanted) / wanted - 0.05) > 1e-6)  # conversion factors are rounded
    is_right = abs(value - wanted) <= 0.05 * abs(wanted)
    for answer in notations(value, unit):
        assert (verdict_of(answer, number(wanted, unit)) == FORMAT) is is_right, answer
        assert verdict_of(answer, number(-wanted, unit)) == WRONG


@settings(max_examples=100)
@given(values=st.lists(VALUES, min_size=2, max_size=4), wanted=st.lists(VALUES, min_size=2, max_size=4))
def test_an_object_by_label_is_right_exactly_if_its_values_are(values: list[float], wanted: list[float]) -> None:
    labels = tuple(f"{'ABCD'[index]}: quantity" for index in range(len(wanted)))
    key = numbers(*wanted, labels=labels)
    is_right = len(values) == len(wanted) and all(
        math.isclose(value, want, rel_tol=1e-12) or verdict_of(value, number(want)) == STRICT
        for value, want in zip(values, wanted, strict=True)
    )
    named: dict[str, JsonValue] = dict(zip("ABCD", values, strict=False))
    answers: list[JsonValue] = [named, dict(reversed(named.items())), json.dumps(named), [list[JsonValue](values)]]
    for answer in answers:
        assert (verdict_of(answer, key) == FORMAT) is is_right, answer
