"""Tests of the six failure detectors on handmade episodes: what they report and ignore, and their evidence."""

import json
from pathlib import Path

import pytest
from pydantic import JsonValue

from evaluator.answers.grading import grade_episode
from evaluator.answers.strict import AnswerKey
from evaluator.commands.program import main
from evaluator.records.episode import Episode, Exchange, Outcome, Turn
from evaluator.scores.failures.detect import failures_of
from evaluator.scores.failures.findings import (
    Failure,
    FailureCount,
    FailureMode,
    expected_form,
    failure_counts,
    quote_at,
)
from scenes.answer_spec import AnswerKind, AnswerSpec, Scalar
from tests.builders.records import UNSCORED, episode, episode_key, refused, rejected, returned, turn

OBJECTS = {"object_1": "cart", "object_2": "wall", "object_3": "ball", "object_4": "ball"}
PROMPT = "| id | name |\n| object_1 | cart |\n| object_2 | wall |\n| object_3 | ball |\n| object_4 | ball |"


def number_key(value: Scalar | tuple[Scalar, ...] = 3.2) -> AnswerKey:
    kind = AnswerKind.NUMBERS if isinstance(value, tuple) else AnswerKind.NUMBER
    return AnswerKey(value, AnswerSpec(kind=kind), OBJECTS)


def answered(*turns: Turn, answer: JsonValue = 5.0, said: str = "", budget: int = 10) -> Episode:
    """An episode that ends with a turn that answers."""
    last = turn(said, returned("answer", answer=answer))
    return episode(*turns, last, key=episode_key(budget=budget), answer=answer, prompt=PROMPT)


def unanswered(*turns: Turn) -> Episode:
    return answered().model_copy(update={"turns": turns, "outcome": Outcome.BUDGET_EXHAUSTED, "answer": None})


def found(episode: Episode, key: AnswerKey | None = None) -> dict[FailureMode, Failure]:
    key = key or number_key()
    return {failure.mode: failure for failure in failures_of(episode, grade_episode(episode, key), expected_form(key))}


LOOK = returned("get_position", {"position": [1.0, 0.0, 0.0]}, object_id="object_1")
WAIT = returned("step", {"sim_time": 1.0}, duration=1.0)
PUSH = returned("apply_force", object_id="object_1", force_vector=[1.0, 0.0, 0.0])
SPEED = returned("get_velocity", {"velocity": [5.0, 0.0, 0.0]}, object_id="object_1")
REST = returned("get_velocity", {"velocity": [0.0, 0.0, 0.0], "sim_time": 0.05}, object_id="object_1")
SOUND = (turn("", PUSH, WAIT), turn("I read the speed.", SPEED))


def test_a_sound_episode_shows_no_failure_even_if_its_answer_is_wrong() -> None:
    assert found(answered(*SOUND, said="The cart moves at 5 m/s.")) == {}


def test_an_unscored_episode_shows_no_failure() -> None:
    key = number_key()
    assert failures_of(answered(said="It is 5."), UNSCORED, expected_form(key)) == ()


# Premature answer.
@pytest.mark.parametrize(
    "turns",
    [
        (),
        (turn("", PUSH, WAIT),),
        (turn("", refused("get_position", "object_1's position is withheld", object_id="object_1")),),
        (turn("I think."),),
    ],
)
def test_an_answer_before_any_reading_is_premature(turns: tuple[Turn, ...]) -> None:
    failure = found(answered(*turns, said="A textbook case. So it is 5."))[FailureMode.PREMATURE_ANSWER]
    (evidence,) = failure.evidence
    assert (evidence.turn, evidence.quote) == (len(turns), "A textbook case.")
    assert evidence.numbers == {"iterations_used": len(turns) + 1, "budget": 10, "readings": 0}
    assert f"{9 - len(turns)} of 10 iterations left" in failure.explanation


def test_a_reading_in_the_answering_turn_does_not_count_as_read() -> None:
    episode = answered()
    last = turn("", LOOK, returned("answer", answer=5.0))
    assert FailureMode.PREMATURE_ANSWER in found(episode.model_copy(update={"turns": (last,)}))
    assert FailureMode.PREMATURE_ANSWER not in found(episode.model_copy(update={"turns": (turn("", LOOK), last)}))


def test_an_answer_in_the_last_iteration_is_not_premature() -> None:
    assert FailureMode.PREMATURE_ANSWER in found(answered(turn("", PUSH, WAIT), budget=3))
    assert FailureMode.PREMATURE_ANSWER not in found(answered(turn("", PUSH, WAIT), budget=2))


# Too little simulated time.
@pytest.mark.parametrize(
    ("turns", "simulated"),
    [
        ((turn("", REST),), 0.0),
        ((turn("", PUSH), turn("", LOOK)), 0.0),
        ((turn("", PUSH, returned("step", duration=0.05), REST),), 0.05),
        ((turn("", PUSH, refused("step", "step: duration must be positive", duration=9.0), REST),), 0.0),
        ((turn("", returned("detect_collision", {"collision_detected": False, "sim_time": 0.0})),), 0.0),
        ((turn("", returned("get_momentum", {"momentum": {"x": 0.0, "y": 1e-17, "z": 0.0}})),), 0.0),
    ],
)
def test_an_answer_about_motion_before_anything_moved_is_too_early(turns: tuple[Turn, ...], simulated: float) -> None:
    failure = found(answered(*turns))[FailureMode.TOO_LITTLE_TIME]
    assert failure.evidence[0].numbers == {"simulated_s": simulated, "least_s": 0.1}
    place = failure.evidence[0]
    assert place.exchange is not None
    assert turns[place.turn].exchanges[place.exchange].call.tool == place.quote


@pytest.mark.parametrize(
    "turns",
    [
        (turn("", LOOK),),
        # An object that already moves may be judged at once.
        (turn("", SPEED),),
        (turn("", PUSH, returned("step", duration=0.01), SPEED, REST),),
        (turn("", returned("detect_collision", {"collision_detected": True})),),
        (turn("", PUSH, returned("step", duration=0.1), REST),),
        (turn("", PUSH, returned("step", duration=0.06), returned("step", duration=0.06), REST),),
        (turn("", returned("create_objects", name="probe"), returned("attach_objects")),),
    ],
)
def test_static_questions_and_enough_time_are_not_too_early(turns: tuple[Turn, ...]) -> None:
    assert FailureMode.TOO_LITTLE_TIME not in found(answered(*turns))


@pytest.mark.parametrize(
    ("said", "too_early"),
    [
        ("So the period is about 2.2 s.", True),
        ("So the period is about 0.9 s.", False),
        ("The periodic force acts for 2.2 s.", False),
        ("The period is 2.2 m.", False),
    ],
)
def test_a_period_longer_than_the_simulated_time_is_too_early(said: str, *, too_early: bool) -> None:
    failure = found(answered(*SOUND, said=said)).get(FailureMode.TOO_LITTLE_TIME)
    assert (failure is not None) == too_early
    if failure is not None:
        assert failure.evidence[0].numbers == {"simulated_s": 1.0, "period_s": 2.2}
        assert failure.evidence[0].quote == said


def test_an_episode_without_an_answer_shows_no_failure() -> None:
    assert found(unanswered(turn("", REST))) == {}
    assert found(unanswered()) == {}


# Answer format.
CHOICE = AnswerKey("left", AnswerSpec(kind=AnswerKind.CHOICE, options=("left", "right", "neither")), OBJECTS)
NUMBERED = AnswerKey("1", AnswerSpec(kind=AnswerKind.CHOICE), OBJECTS)
CART = AnswerKey("object_1", AnswerSpec(kind=AnswerKind.OBJECTS), OBJECTS)
LENGTH = AnswerKey(3.2, AnswerSpec(kind=AnswerKind.NUMBER, unit="m"), OBJECTS)


@pytest.mark.parametrize(
    ("key", "answer", "why"),
    [
        (number_key((1.0, 2.0)), "5.0", "2 values were asked for"),
        (number_key((1.0, 2.0)), [1.0, 2.0, 3.0], "2 values were asked for"),
        (number_key(), [1.0, 2.0], "one value was asked for"),
        (number_key(), "quickly", "words, where a number was asked for"),
        (LENGTH, "320 cm", "right, but for its form (partial answer format)"),
        (CHOICE, "upwards", "none of the options"),
        (NUMBERED, "increases", "words, where a number was asked for"),
        (CART, "the cart on the left", "no id of an object"),
    ],
)
def test_an_answer_in_the_wrong_form_is_a_format_mismatch(key: AnswerKey, answer: JsonValue, why: str) -> None:
    failure = found(answered(*SOUND, answer=answer), key)[FailureMode.ANSWER_FORMAT]
    assert failure.explanation == f"It answered in another form than was asked for: {why}."
    assert (failure.evidence[0].turn, failure.evidence[0].exchange) == (2, 0)


@pytest.mark.parametrize(
    ("key", "answer"),
    [
        (number_key(), 5.0),
        (number_key(), "3.2"),
        (number_key((1.0, 2.0)), "1.0, 5.0"),
        (CHOICE, " Right"),
        (CART, "object_2"),
        (CART, "2"),
        (NUMBERED, "2"),
        (AnswerKey("friction", AnswerSpec(kind=AnswerKind.TEXT), OBJECTS), "inertia"),
    ],
)
def test_an_answer_in_the_expected_form_is_no_format_mismatch(key: AnswerKey, answer: JsonValue) -> None:
    assert FailureMode.ANSWER_FORMAT not in found(answered(*SOUND, answer=answer), key)


@pytest.mark.parametrize("value", [7.25, (7.25, 8.5)])
def test_no_failure_reveals_the_key(value: Scalar | tuple[Scalar, ...]) -> None:
    failures = found(answered(answer="quickly", said="It is fast."), number_key(value))
    published = " ".join(failure.model_dump_json() for failure in failures.values())
    assert FailureMode.ANSWER_FORMAT in failures
    assert "7.25" not in published
    assert "8.5" not in published


# Object ids.
@pytest.mark.parametrize(
    "exchange",
    [
        refused("get_position", "there is no object 'object_9'; the objects are object_1", object_id="object_9"),
        refused("get_position", "Body with name 'object_9' not found in the scene.", object_id="object_9"),
        rejected("apply_force", object_id="object_9", force_vector=[1.0]),
    ],
)
def test_an_object_id_that_the_agent_was_not_given_is_a_confusion(exchange: Exchange) -> None:
    failure = found(answered(turn("", LOOK, exchange), *SOUND))[FailureMode.OBJECT_ID]
    assert (failure.evidence[0].turn, failure.evidence[0].exchange) == (0, 1)
    assert failure.explanation == "It named an object that it did not know of in 1 call."


@pytest.mark.parametrize(
    "exchange",
    [
        refused("get_position", "the position of object_2 is withheld", object_id="object_2"),
        refused("set_velocity", "Joint named object_1_joint not found.", object_id="object_1"),
        rejected("apply_force", object_id="object_1", force_vector=[1.0]),
        refused("create_objects", "create_objects: there is an object 'probe' already", name="probe"),
    ],
)
def test_a_known_object_used_in_a_forbidden_way_is_no_confusion(exchange: Exchange) -> None:
    assert FailureMode.OBJECT_ID not in found(answered(turn("", exchange), *SOUND))


def test_an_id_in_an_earlier_result_is_known() -> None:
    revealed = returned("find_objects").model_copy(update={"text": '{"revealed": ["object_9"]}'})
    misfit = rejected("apply_force", object_id="object_9", force_vector=[1.0])
    assert FailureMode.OBJECT_ID in found(answered(turn("", misfit), *SOUND))
    assert FailureMode.OBJECT_ID not in found(answered(turn("", revealed, misfit), *SOUND))


@pytest.mark.parametrize(
    ("said", "mistaken"),
    [
        ("The cart (object_2) hits first.", True),
        ("Look at object_1 (wall), it moves.", True),
        ("`object_2` (`cart`) hits first.", True),
        ("The cart (object_1) hits the wall (object_2).", False),
        ("The ball (object_3) and object_4 (ball) are alike.", False),
        ("The heavy one (object_2) hits first.", False),
    ],
)
def test_an_id_written_with_the_name_of_another_object_is_a_confusion(said: str, *, mistaken: bool) -> None:
    failure = found(answered(*SOUND, said=said)).get(FailureMode.OBJECT_ID)
    assert (failure is not None) == mistaken
    if failure is not None:
        assert (failure.explanation, failure.evidence[0].quote) == ("It took one object for another.", said)


# Parameters.
@pytest.mark.parametrize(
    "exchange",
    [
        rejected("set_velocity", object_id="object_1", velocity_vector=[1.0, 0.0]),
        refused("step", "step: duration must be greater than 0", duration=-1.0),
        refused("set_velocity", "Failed to set velocity: velocity_vector must be a list of 3", object_id="object_1"),
        returned("get_kinetic_energy", {"kinetic_energy": 1.0}, object_id="object_1", mass="MASS_FROM_PREVIOUS_RESULT"),
    ],
)
def test_arguments_that_do_not_fit_are_a_wrong_parameter(exchange: Exchange) -> None:
    failure = found(answered(turn("", LOOK, exchange), *SOUND))[FailureMode.WRONG_PARAMETER]
    assert [(evidence.turn, evidence.exchange) for evidence in failure.evidence] == [(0, 1)]


def computed(tool: str, object_id: str, mass: float = 1) -> Exchange:
    return returned(tool, {"value": 0.5}, object_id=object_id, mass=mass)


WEIGHED = [
    returned("get_parameters", {"mass": mass}, object_id=name) for name, mass in (("object_1", 2.0), ("object_2", 2.0))
]
HEAVIER = returned("get_parameters", {"mass": 4.0}, object_id="object_2")


@pytest.mark.parametrize(
    ("weighed", "calls", "wrong"),
    [
        # The worked example of the prompt: ω = 2 E / L, for any mass.
        (WEIGHED, [("get_rotational_energy", "object_1", 1), ("get_angular_momentum", "object_1", 1)], False),
        (WEIGHED, [("get_kinetic_energy", "object_1", 1), ("get_momentum", "object_1", 1)], False),
        # Two objects of one mass are compared.
        (WEIGHED, [("get_angular_momentum", "object_1", 1), ("get_angular_momentum", "object_2", 1)], False),
        # A mass does not cancel: the masses differ, one result is alone, or the results have no common quotient.
        ([WEIGHED[0], HEAVIER], [("get_momentum", "object_1", 1), ("get_momentum", "object_2", 1)], True),
        (WEIGHED, [("get_momentum", "object_1", 1)], True),
        (WEIGHED, [("get_rotational_energy", "object_1", 1), ("get_momentum", "object_1", 1)], True),
        (WEIGHED, [("get_rotational_energy", "object_1", 1), ("get_angular_momentum", "object_1", 3)], True),
    ],
)
def test_a_mass_that_cancels_in_a_ratio_is_no_wrong_parameter(
    weighed: list[Exchange], calls: list[tuple[str, str, float]], *, wrong: bool
) -> None:
    made = [computed(*call) for call in calls]
    assert (FailureMode.WRONG_PARAMETER in found(answered(*SOUND, turn("", *weighed), turn("", *made)))) is wrong


@pytest.mark.parametrize(("mass", "wrong"), [(1.0, True), (2.2, True), (2.05, False), (2.0, False)])
def test_a_mass_that_differs_from_the_measured_one_is_a_wrong_parameter(mass: float, *, wrong: bool) -> None:
    energy = returned("get_kinetic_energy", {"kinetic_energy": 1.0}, object_id="object_1", mass=mass)
    weigh = returned("get_parameters", {"mass": 2.0}, object_id="object_1")
    failure = found(answered(turn("", energy, weigh), *SOUND)).get(FailureMode.WRONG_PARAMETER)
    assert (failure is not None) == wrong
    if failure is not None:
        assert failure.evidence[0].numbers == {"given_kg": mass, "measured_kg": 2.0}


@pytest.mark.parametrize(
    "exchange",
    [
        returned("get_kinetic_energy", {"kinetic_energy": 1.0}, object_id="object_2", mass=7.0),
        refused("move_object", "object_2 is fixed in the laboratory and cannot move", object_id="object_2", x=1.0),
        returned("attach_objects", object1_id="object_1", object2_id="object_2", joint="fixed"),
        returned("create_objects", name="probe", pos=[0.0, 0.0, 1.0], density=1.0),
        returned("get_position", object_id="1"),
    ],
)
def test_a_call_that_fits_is_no_wrong_parameter(exchange: Exchange) -> None:
    weigh = returned("get_parameters", {"mass": 2.0}, object_id="object_1")
    assert FailureMode.WRONG_PARAMETER not in found(answered(turn("", weigh, exchange), *SOUND))


# Theory and simulation.
@pytest.mark.parametrize(
    ("episode", "words"),
    [
        (answered(said="By energy conservation it is 5."), "without a reading"),
        (answered(*SOUND, said="I will calculate this analytically: 5."), "set aside"),
        (answered(*SOUND, said="The textbook value is 5."), "set aside"),
        (answered(*SOUND, said="I'll assume a standard angle, so 5."), "set aside"),
        (answered(turn("", LOOK), said="Given the names, it is 5."), "what the objects are called"),
        (answered(*SOUND, said="Its naming indicates that it is 5."), "what the objects are called"),
        (answered(*SOUND, said="Despite the name, which implies 3, I trust the unusual 5."), "called unexpected"),
        (answered(*SOUND, turn("The speed contradicts what I expect."), said="It is 5."), "called unexpected"),
        (answered(*SOUND, said="A counterintuitive value, but it is 5."), "called unexpected"),
    ],
)
def test_an_answer_from_theory_or_from_doubted_readings_is_reported(episode: Episode, words: str) -> None:
    failure = found(episode)[FailureMode.THEORY_OR_SIMULATION]
    assert words in failure.explanation
    place = failure.evidence[0]
    assert place.quote
    assert place.quote in episode.turns[place.turn].reasoning


@pytest.mark.parametrize(
    "episode",
    [
        answered(*SOUND, said="This matches the theoretical value: 5."),
        answered(turn("", LOOK), said="I'll assume a standard angle, so 5."),
        answered(said="I guess."),
        answered(),
        unanswered(turn("By theory it is 5.")),
        answered(turn("An unexpected result."), *SOUND, turn("", LOOK), turn("", LOOK), said="It is 5."),
    ],
)
def test_theory_that_agrees_with_the_readings_is_not_reported(episode: Episode) -> None:
    assert FailureMode.THEORY_OR_SIMULATION not in found(episode)


# Counting and quoting.
def test_every_mode_is_counted_over_all_and_over_wrong_answers() -> None:
    key = number_key(5.0)
    right, wrong = answered(said="It is 5."), answered(answer=9.0, said="It is 9.")
    grades = [grade_episode(episode, key) for episode in (right, wrong)]
    shown = failures_of(right, grades[0], expected_form(key))
    counts = failure_counts([(grades[0], shown), (grades[1], shown), (UNSCORED, shown)])
    assert counts[FailureMode.PREMATURE_ANSWER] == FailureCount(n=2, n_incorrect=1)
    assert counts[FailureMode.OBJECT_ID] == FailureCount(n=0, n_incorrect=0)
    assert list(counts) == list(FailureMode)


def test_a_quote_is_the_short_sentence_around_a_position() -> None:
    text = "First this. Then that happened!\nAt last 3.5 m."
    assert quote_at(text) == "First this."
    assert quote_at(text, text.index("that")) == "Then that happened!"
    assert quote_at(text, text.index("3.5")) == "At last 3.5 m."
    assert quote_at("") == ""
    assert len(quote_at("word " * 500, 1200)) <= 160
    assert "word" in quote_at("word " * 500, 1200)


def test_a_failure_has_at_most_20_pieces_of_evidence_of_a_kind() -> None:
    unknown = refused("get_position", "there is no object 'object_9'", object_id="object_9")
    misfit = rejected("step", duration="long")
    failures = found(answered(turn("", *[unknown] * 50, *[misfit] * 50), said="The cart (object_2) moves. " * 50))
    assert failures[FailureMode.OBJECT_ID].explanation == (
        "It named an object that it did not know of in 50 calls and took one object for another."
    )
    assert len(failures[FailureMode.OBJECT_ID].evidence) == 40
    assert len(failures[FailureMode.WRONG_PARAMETER].evidence) == 20


# A whole run.
def test_the_reference_agent_shows_no_failure_and_the_summary_lists_every_mode(tmp_path: Path, host_url: str) -> None:
    run = tmp_path / "run"
    assert (
        main(
            [
                "run",
                "--agent",
                "reference",
                "--scenes",
                "7,60",
                "--budgets",
                "20",
                "--server",
                host_url,
                "--out",
                str(run),
            ]
        )
        == 0
    )
    overall = json.loads((run / "summary.json").read_text(encoding="utf-8"))["overall"]
    assert overall["n_scored"] == 2
    assert overall["failures"] == {mode.value: {"n": 0, "n_incorrect": 0} for mode in FailureMode}


def test_the_summary_counts_the_failures_of_an_agent_that_never_looks(tmp_path: Path, host_url: str) -> None:
    run = tmp_path / "run"
    assert main(
        ["run", "--agent", "blind", "--scenes", "7,60", "--budgets", "20", "--server", host_url, "--out", str(run)]
    ) in {0, 1}
    overall = json.loads((run / "summary.json").read_text(encoding="utf-8"))["overall"]
    wrong = overall["n_scored"] - overall["n_correct"]
    assert overall["failures"]["premature_answer"] == {"n": 2, "n_incorrect": wrong}


def test_the_form_of_an_answer_is_not_judged_where_another_question_was_asked() -> None:
    """A published log may be older than its pack's wording, which may ask for another form of answer."""
    key, words = number_key(), answered(*SOUND, answer="faster")
    form = expected_form(key, "How fast is the cart?\nAnswer in m/s.")
    for prompt, judged in (
        ("Task: How fast is the cart? Answer in m/s..", True),
        ("# Scene\n\nHow fast is the cart?\nAnswer in m/s.\n\n# Objects", True),
        ("Task: Does the cart get faster or slower?.", False),
        ("Task: How fast is the cart?.", False),
    ):
        played = words.model_copy(update={"prompt": prompt})
        shown = {failure.mode for failure in failures_of(played, grade_episode(played, key), form)}
        assert (FailureMode.ANSWER_FORMAT in shown) is judged
