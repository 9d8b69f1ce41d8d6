"""Tests of grounding on transcripts checked by hand: which numbers are assertions, and which return supports them."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluator.quantities.spoken import spoken_numbers
from evaluator.records.episode import Exchange
from evaluator.scores.grounding import Assertion, Grounding, grounding_of
from tests.builders.records import episode, refused, returned, skipped, turn

VELOCITY = returned("get_velocity", {"sim_time": 0.8, "velocity": [0.0, 0.25, -7.848]}, object_id="object_1")
POSITION = returned("get_position", {"sim_time": 0.8, "position": [0.0, 0.523, 26.86]}, object_id="object_1")


def texts(grounding: Grounding, *, supported: bool) -> list[str]:
    return [one.text for one in grounding.assertions if (one.support is not None) == supported]


def after(reasoning: str, *exchanges: Exchange, prompt: str = "") -> Grounding:
    """Return the grounding of a turn's reasoning, after a turn with some results."""
    return grounding_of(episode(turn("", *exchanges), turn(reasoning), prompt=prompt))


def test_an_assertion_is_linked_to_the_value_that_supports_it() -> None:
    result = after("It falls with -7.85 m/s.", POSITION, VELOCITY)
    (assertion,) = result.assertions
    assert assertion == Assertion(turn=1, start=14, end=23, text="-7.85 m/s", support=assertion.support)
    assert assertion.support is not None
    assert assertion.support.model_dump() == {"turn": 0, "exchange": 1, "path": "$.velocity[2]", "value": -7.848}
    assert result.share == 1


def test_a_whole_trace_counted_by_hand() -> None:
    prompt = "The ball is released from 30 m. You have 20 iterations."
    fall = returned("step", {"sim_time": 0.8, "steps": 160, "results": None}, duration=0.8)
    result = grounding_of(
        episode(
            # The prompt has 30, the agent's own call has 0.8; 9.81 is neither, and nothing was returned yet: 0 of 1.
            turn("I drop it from 30 m, wait 0.8 s and expect g = 9.81.", fall, VELOCITY),
            # -7.848 and 0.25 were returned; 10 was not, and 9.81 is computed (7.848 / 0.8): 2 of 4.
            turn("object_1 has v = [0.25, -7.848] m/s, so g is 9.81, not 10.", POSITION),
            # 52.3 cm is 0.523 m; 0.24 is not 0.25: 1 of 2.
            turn("Iteration 3: it moved 52.3 cm sideways, at 0.24 m/s."),
            prompt=prompt,
        )
    )
    assert texts(result, supported=True) == ["0.25", "-7.848", "52.3 cm"]
    assert texts(result, supported=False) == ["9.81", "9.81", "10", "0.24 m/s"]
    assert result.share == pytest.approx(3 / 7)


def test_a_return_supports_later_turns_only() -> None:
    same = grounding_of(episode(turn("It reads -7.848 m/s.", VELOCITY)))
    assert same.share == 0
    assert after("I read -7.848 m/s.", VELOCITY).share == 1


def test_of_several_supporting_returns_the_latest_is_linked() -> None:
    result = grounding_of(episode(turn("", VELOCITY), turn("", VELOCITY), turn("So -7.848.")))
    assert [one.support.turn for one in result.assertions if one.support] == [1]


def test_calls_that_failed_or_did_not_run_support_nothing() -> None:
    failed = refused("get_velocity", "no: 1.5").model_copy(update={"content": {"velocity": [1.5, 0, 0]}})
    assert after("It is 1.5 m/s.", failed, skipped("get_velocity")).share == 0


@pytest.mark.parametrize(
    "said",
    [
        *("-7.848", "-7.85", "-7.8 m/s", "-8", "-8 m/s", "−7.848 m/s", "-7.848e0", "-785 cm/s", "-28.25 km/h"),
        *("-7.848 metres per second", "0.25 m/s", "0.25m/s", "2.5e-1", "2.5×10^-1 m/s", "2.5×10⁻¹", "250 mm/s"),
        *("(0, 0.25, -7.848) m/s", "0.8 s", "800 ms", r"-7.848\,\text{m/s}", "**-7.848 m/s**", "0.3"),
    ],
)
def test_a_number_matches_at_the_precision_and_in_the_unit_written(said: str) -> None:
    assert after(f"It is {said} now.", VELOCITY).share == 1


@pytest.mark.parametrize(
    "said",
    [
        *("7.848", "7.85 m/s", "-7.849", "-7.8481", "-7.9 m/s", "-7.848 cm/s", "-7.848 m", "-7.848 kg", "0.25 N"),
        *("-0.25", "0.2501", "0.25 degrees", "25 %", "800 s"),
    ],
)
def test_a_number_of_another_magnitude_sign_or_unit_is_not_supported(said: str) -> None:
    assert after(f"It is {said} now.", VELOCITY).share == 0


def test_the_unit_of_bare_components_is_that_of_their_tool() -> None:
    acceleration = returned("get_acceleration", {"sim_time": 1.0, "x": 2.5, "y": 0.0, "z": 0.0})
    force = returned("compute_force", {"sim_time": 1.0, "x": 4.5, "y": 0.0, "z": 0.0})
    result = after("2.5 m/s^2 and 4.5 N, not 2.5 N and 4.5 m/s².", acceleration, force)
    assert texts(result, supported=True) == ["2.5 m/s^2", "4.5 N"]


def test_an_angle_is_converted_from_degrees_only_if_degrees_are_written() -> None:
    angle = returned("read_angle", {"angle": 0.5236})
    result = after("30.00° or 30.00 degrees is 0.5236 rad, not 30.00.", angle)
    assert texts(result, supported=True) == ["30.00°", "30.00 degrees", "0.5236 rad"]


def test_values_inside_objects_and_lists_have_their_paths() -> None:
    found = returned("find_objects", {"revealed": [{"object_id": "object_4", "position": [1.25, 2.5, 3.75]}]})
    result = after("It is at 2.5 m.", found)
    assert result.assertions[0].support is not None
    assert result.assertions[0].support.path == "$.revealed[0].position[1]"


@pytest.mark.parametrize(
    "said",
    [
        *("object_2", "x1 and v0", "iteration 3", "Step 2:", "3 more steps", "in 4 iterations", "ball 2", "m/s^2"),
        *("1. Push it\n2. Read it\n3) Think", "r^2 and r^{-3} and r**4", "2D, 3rd, 2gh", "3 times", "10 turns left"),
        *("two", "", "attempt #2", "version 3.3.3"),
    ],
)
def test_numbers_that_are_no_measurements_are_no_assertions(said: str) -> None:
    result = after(said, VELOCITY)
    assert result.assertions == ()
    assert result.share is None


@pytest.mark.parametrize(
    "said",
    [
        *("I = 2/5 m r^2", "I = (2/5)mr²", "V = (4/3)πr³", r"\(I = \frac{1}{12} m L^2\)", r"\frac{5}{7} g \sin\theta"),
        *(r"T = 2\pi\sqrt{L/g}", r"c = 2 \sqrt{m k}", "T = 2π√(L/g)", "repeat steps 1-4", "iterations 3 to 5", "½mv²"),
        *("objects 1 and 2", "steps 1–4"),
    ],
)
def test_coefficients_of_formulas_and_ranges_of_steps_are_no_assertions(said: str) -> None:
    assert after(said, VELOCITY).assertions == ()


@pytest.mark.parametrize(
    ("said", "numbers"),
    [
        ("a = 9.81/7 and 20/0.5", ["9.81", "7", "20", "0.5"]),
        ("64/24 is a ratio of two sizes", ["64", "24"]),
        (r"\frac{2.2}{4.4}", ["2.2", "4.4"]),
        (r"1.5\theta, 3\,\text{m}", ["1.5", r"3\,\text{m}"]),
    ],
)
def test_numbers_in_a_quotient_are_assertions(said: str, numbers: list[str]) -> None:
    assert [one.text for one in after(said, VELOCITY).assertions] == numbers


@pytest.mark.parametrize(
    "said",
    [
        *("a speed of 7.85 m/s", "the magnitude is 7.85", "|7.85| m/s", "7.85 m/s downward", "7.85 (magnitude)"),
        *("the speed is about 7.8 m/s", r"\(7.85\) downwards", "7.85 m/s in magnitude", "a speed of 0.25 m/s"),
    ],
)
def test_a_number_called_a_magnitude_is_supported_by_a_value_of_either_sign(said: str) -> None:
    assert after(said, VELOCITY).share == 1


@pytest.mark.parametrize(
    "said",
    [
        *("it moves at 7.85 m/s", "a speed of -0.25 m/s", "the speed drops. Then 7.85 m/s", "a velocity of 7.85 m/s"),
        *("the speed is 3 m/s, not 7.86", "the magnitude of 0.25 is 7.85 too little"),
    ],
)
def test_a_number_not_called_a_magnitude_needs_the_same_sign(said: str) -> None:
    grounding = after(said, VELOCITY)
    assert grounding.assertions[-1].support is None


def test_the_result_of_a_product_is_an_assertion() -> None:
    mass = returned("get_parameters", {"sim_time": 0.0, "mass": 2.5})
    result = after("The weight is 2.5 kg × 9.81 = 24.525 N.", mass, prompt="Gravity is 9.81 m/s^2.")
    assert texts(result, supported=True) == ["2.5 kg"]
    assert texts(result, supported=False) == ["24.525 N"]


def test_numbers_of_the_prompt_are_no_assertions() -> None:
    prompt = "Gravity is 9.81 m/s². The ramp stands at 20 degrees and is 0.5 m long."
    result = after("With g = 9.81, or 9.8, on 50 cm at 20° (0.3491 rad): 10 m/s.", VELOCITY, prompt=prompt)
    assert [one.text for one in result.assertions] == ["10 m/s"]


def test_arguments_of_calls_are_no_assertions_except_the_answer() -> None:
    push = returned("apply_force", {"force": [-2.0, 0, 0]}, force_vector=[-2.0, 0, 0])
    answer = returned("answer", {"acknowledged": True}, answer=3.5)
    result = grounding_of(episode(turn("I push with 2 N.", push), turn("2 N gave 3.5 kg.", answer)))
    assert texts(result, supported=False) == ["3.5 kg"]
    assert result.share == 0


def test_a_minus_between_numbers_is_no_sign_and_a_range_has_two_numbers() -> None:
    spoken = [float(one.value) for one in spoken_numbers("5-3, 2 - 4, a-6, (1)-7, x=-8, from 0.5–0.75, (-9)")]
    assert spoken == [5, 3, 2, 4, 6, 1, 7, -8, 0.5, 0.75, -9]


def test_a_thousands_separator_is_not_taken_for_a_separator_of_components() -> None:
    spoken = [float(one.value) for one in spoken_numbers("2,939.6 J and (1,100) and [0,250] m")]
    assert spoken == [2939.6, 1, 100, 0, 250]


@settings(max_examples=150)
@given(
    reasoning=st.lists(
        st.sampled_from([*"0123456789.,-+eE^*/()[]{} \n", "m/s", "×10^", "object_", "step ", "°", "−", "\\text{", "%"]),
        max_size=60,
    ).map("".join)
)
def test_any_text_is_read_and_every_assertion_has_its_position(reasoning: str) -> None:
    result = after(reasoning, VELOCITY)
    assert result.share is None or 0 <= result.share <= 1
    for one in result.assertions:
        assert reasoning[one.start : one.end] == one.text
        assert any(character.isdigit() for character in one.text)


@settings(max_examples=150)
@given(value=st.floats(min_value=0.001, max_value=1e4), places=st.integers(min_value=0, max_value=6))
def test_a_returned_value_rounded_to_any_precision_is_supported(value: float, places: int) -> None:
    reading = returned("get_velocity", {"velocity": [value, 0.0, 0.0]})
    result = after(f"v is {value:.{places}f} m/s.", reading)
    assert result.share == 1
