"""Tests that the detectors find the failure mode of each of the six episodes that the paper prints as examples."""

import pytest

from evaluator.answers.grading import grade_episode
from evaluator.answers.strict import AnswerKey
from evaluator.records.episode import Episode, Exchange, Outcome, Turn
from evaluator.scores.failures.detect import failures_of
from evaluator.scores.failures.findings import FailureMode, expected_form
from scenes.answer_spec import AnswerKind, AnswerSpec, Scalar
from tests.builders.records import episode, episode_key, refused, returned, turn

BLOCKS = {"object_1": "block", "object_2": "block"}
ROPES = {"object_1": "mass_1", "object_2": "mass_2", "object_3": "rope_1", "object_4": "rope_2"}
NUMBER = AnswerSpec(kind=AnswerKind.NUMBER)
CHOICE = AnswerSpec(kind=AnswerKind.CHOICE)


def place(object_id: str, *position: float) -> Exchange:
    return returned("get_position", {"sim_time": 0.0, "position": list(position)}, object_id=object_id)


def step(duration: float) -> Exchange:
    return returned("step", {"sim_time": duration}, duration=duration)


def ended(*turns: Turn, answer: Scalar, said: str, budget: int, prompt: str) -> Episode:
    last = turn(said, returned("answer", answer=answer))
    key = episode_key(budget=budget)
    return episode(*turns, last, key=key, answer=answer, prompt=prompt, outcome=Outcome.ANSWERED)


S48 = ended(
    turn("I measure the incline angle directly: rise 0.5, run 2.0.", place("object_1", -2.0, -0.6, 0.5), step(0.5)),
    answer=0.24,
    said="From geometry the run is 2.088 m, so mu = tan(theta) = 0.24.",
    budget=5,
    prompt="Determine the coefficient of static friction using the critical angle at which the block begins to slide.",
)
S89 = ended(
    turn("I move the bob.", refused("move_object", "move_object: y must be a number", object_id="object_1")),
    turn("I push it.", returned("apply_force", object_id="object_1", force_vector=[1.0, 0.0, 0.0]), step(0.1)),
    turn("", place("object_1", 0.0, 0.0, 0.0), returned("get_velocity", {"velocity": [0.0, 0.0, 0.0]})),
    answer=2.9,
    said="It does not oscillate, so I apply the formula: T = 2π√(L/g) = 2π√(2/9.81) ≈ 2.843 s.",
    budget=15,
    prompt="Determine the period of oscillation for a simple pendulum with a length of 2 meters.",
)
S63 = ended(
    turn("I spin the platform.", returned("apply_torque", object_id="object_1", torque_vector=[0, 0, 1]), step(1.0)),
    turn("", returned("get_angular_momentum", {"angular_momentum": {"x": 0.0, "y": 0.0, "z": 1e-6}}, mass=1.0)),
    answer=1.05,
    said="I computed the ratio of the final to the initial angular velocity, 1.05.",
    budget=20,
    prompt="Observe how angular velocity changes when masses are moved closer to the center.",
)
S68 = ended(
    turn(
        "I read the masses.",
        returned("get_parameters", {"mass": 0.00419}, object_id="object_1"),
        returned("get_parameters", {"mass": 0.00838}, object_id="object_2"),
    ),
    turn("", place("object_3", 0.0, 0.0, 2.0), place("object_4", 1.0, 0.0, 2.0)),
    answer=4,
    said="rope_2 holds mass_2, so rope_2 (object_4) has the higher tension.",
    budget=20,
    prompt="Identify which rope has higher tension based on the mass it supports.",
)
S91 = ended(
    turn("I read the disk.", returned("get_parameters", {"mass": 3.14159}, object_id="object_1")),
    answer=19.635,
    said="The simulator shows that the actual disk mass is 3.14159 kg, so I should use that verified value: 19.635 J.",
    budget=15,
    prompt="Determine the rotational energy of a disk with radius 0.5 m, mass 2 kg, and angular velocity 10 rad/s.",
)
S14 = ended(
    turn("I push both.", returned("apply_force", object_id="object_1", force_vector=[5.0, 0.0, 0.0]), step(2.0)),
    turn(
        "",
        returned("get_displacement", {"displacement": 0.1}, object_id="object_1"),
        returned("get_displacement", {"displacement": 4.001}, object_id="object_2"),
    ),
    answer=2,
    said="Physically, the low friction block should travel further. However, my simulation results indicate that"
    " object_2 traveled significantly further.",
    budget=10,
    prompt="Determine which block will travel further when pushed with the same force.",
)


# The same traces in forms nearer to the paper's.
S48_READ_AFTERWARDS = ended(
    turn(
        "Rise 0.5 m over a run of 2.0 m gives mu = tan(theta) = 0.25. I step once to verify.",
        place("object_1", -2.0, -0.6, 0.5),
        step(0.5),
        place("object_1", -1.71, -0.6, 0.43),
    ),
    answer=0.24,
    said="Refined, the run is sqrt((-2.0)^2 + (-0.6)^2) = 2.088 m, so mu = 0.5 / 2.088 = 0.240.",
    budget=5,
    prompt=S48.prompt,
)
S48_FROM_GEOMETRY = S48_READ_AFTERWARDS.model_copy(
    update={
        "turns": (
            S48_READ_AFTERWARDS.turns[0],
            turn("From geometry: mu = tan(theta) = 0.24.", *S48_READ_AFTERWARDS.turns[1].exchanges),
        )
    }
)
S48_EXPERIMENT = S48_READ_AFTERWARDS.model_copy(
    update={
        "turns": (
            S48_READ_AFTERWARDS.turns[0],
            turn("It slid from -2.0 m to -1.71 m, so a = 2.3 m/s².", *S48_READ_AFTERWARDS.turns[1].exchanges),
        )
    }
)


def latex(said: str) -> Episode:
    """The paper's trace S89 with other words in its answering turn."""
    last = S89.turns[-1]
    return S89.model_copy(update={"turns": (*S89.turns[:-1], turn(said, *last.exchanges))})


S89_IN_LATEX = [
    latex(said)
    for said in (
        r"It does not move. $T = 2\pi\sqrt{L/g} = 2\pi\sqrt{2/9.81} \approx 2.843$ s.",
        r"\( T = 2\pi\sqrt{\frac{L}{g}} = 2\pi\sqrt{\frac{2}{9.81}} \approx 2.843 \, \text{s} \)",
        r"$$T \approx 2\pi\sqrt{\dfrac{2}{9.81}} = 2.843\ \mathrm{s}$$",
    )
]
S14_WITH_A_CLAUSE = S14.model_copy(
    update={
        "turns": (
            *S14.turns[:-1],
            turn(
                "Physically, the low friction block should travel further because less of its energy is lost"
                " along the way. However, my simulation results indicate that object_2 traveled further.",
                *S14.turns[-1].exchanges,
            ),
        )
    }
)


def modes(played: Episode, key: AnswerKey) -> set[FailureMode]:
    return {failure.mode for failure in failures_of(played, grade_episode(played, key), expected_form(key))}


@pytest.mark.parametrize(
    ("played", "key", "mode"),
    [
        pytest.param(S48_READ_AFTERWARDS, AnswerKey(0.6, NUMBER, BLOCKS), FailureMode.PREMATURE_ANSWER, id="S48 read"),
        pytest.param(S48_FROM_GEOMETRY, AnswerKey(0.6, NUMBER, BLOCKS), FailureMode.PREMATURE_ANSWER, id="S48 said"),
        *(
            pytest.param(
                played, AnswerKey(2.837, NUMBER, BLOCKS), FailureMode.TOO_LITTLE_TIME, id=f"S89 LaTeX {number}"
            )
            for number, played in enumerate(S89_IN_LATEX)
        ),
        pytest.param(
            S14_WITH_A_CLAUSE, AnswerKey(1, CHOICE, BLOCKS), FailureMode.THEORY_OR_SIMULATION, id="S14 clause"
        ),
        pytest.param(S48, AnswerKey(0.6, NUMBER, BLOCKS), FailureMode.PREMATURE_ANSWER, id="S48"),
        pytest.param(S89, AnswerKey(2.837, NUMBER, BLOCKS), FailureMode.TOO_LITTLE_TIME, id="S89"),
        pytest.param(S63, AnswerKey(2, CHOICE, BLOCKS), FailureMode.ANSWER_FORMAT, id="S63"),
        pytest.param(S68, AnswerKey(2, CHOICE, ROPES), FailureMode.OBJECT_ID, id="S68"),
        pytest.param(S91, AnswerKey(12.5, NUMBER, BLOCKS), FailureMode.WRONG_PARAMETER, id="S91"),
        pytest.param(S14, AnswerKey(1, CHOICE, BLOCKS), FailureMode.THEORY_OR_SIMULATION, id="S14"),
    ],
)
def test_a_trace_of_the_paper_shows_its_failure_mode(played: Episode, key: AnswerKey, mode: FailureMode) -> None:
    assert mode in modes(played, key)


def test_an_answer_from_what_was_read_after_the_step_is_not_premature() -> None:
    assert FailureMode.PREMATURE_ANSWER not in modes(S48_EXPERIMENT, AnswerKey(0.6, NUMBER, BLOCKS))


def test_a_measured_mass_is_no_wrong_parameter_where_the_task_states_none_or_the_same() -> None:
    for prompt in ("A disk.", "A disk with a mass of 3.14 kg."):
        played = S91.model_copy(update={"prompt": prompt})
        key = AnswerKey(12.5, NUMBER, BLOCKS)
        assert FailureMode.WRONG_PARAMETER not in modes(played, key)


def test_an_answer_that_was_measured_is_no_confusion() -> None:
    played = S68.model_copy(update={"answer": 1})
    key = AnswerKey(2, CHOICE, ROPES)
    assert FailureMode.OBJECT_ID not in modes(played, key)
