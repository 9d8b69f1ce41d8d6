"""Detectors that examine the answer: given too early, in the wrong form, or after too little simulated time."""

import re

from pydantic import JsonValue

from evaluator.answers.forms import Item, as_item, plain_number, strict_items
from evaluator.failures.course import (
    MOTION_READINGS,
    PUSHES,
    Place,
    exchanges,
    has_answered,
    read_before_answer,
    shows_motion,
    step_duration,
    succeeded,
)
from evaluator.failures.findings import Evidence, ExpectedForm, Failure, FailureMode, answering_turn, quote_at
from evaluator.quantities.spoken import spoken_numbers
from evaluator.quantities.units import parse_unit
from evaluator.records import Episode, Grade, Verdict
from scenes.pack import AnswerKind

LEAST_TIME_S = 0.1
"""Simulated time below which an answer about motion counts as too early [s]: 20 time steps of 5 ms."""

_PERIOD = re.compile(r"\bperiod\b[^.\n]{0,24}$", re.IGNORECASE)
_SECOND = parse_unit("s")
_OBJECT_ID = re.compile(r"object_\d+|\d+")


def premature_answer(episode: Episode) -> Failure | None:
    """Answered before it had seen the result of any successful reading, with iterations left.

    Readings in the same batch as the answer do not count, because the agent had not seen them.
    """
    if not has_answered(episode) or len(episode.turns) >= episode.allowance or read_before_answer(episode):
        return None
    turn = answering_turn(episode)
    left = episode.allowance - len(episode.turns)
    turns = "iterations" if episode.max_calls is None else "calls"
    return Failure(
        mode=FailureMode.PREMATURE_ANSWER,
        explanation=f"It answered with {left} of {episode.allowance} {turns} left, before any reading.",
        evidence=(
            Evidence(
                turn=turn,
                quote=quote_at(episode.turns[turn].reasoning),
                numbers={f"{turns}_used": len(episode.turns), "budget": episode.allowance, "readings": 0},
            ),
        ),
    )


def too_little_time(episode: Episode) -> Failure | None:
    """Answered about motion before anything moved, or stated a period longer than the simulated time.

    The first case: less than `LEAST_TIME_S` was simulated in total, and either every reading of motion was 0, or
    something was pushed or given a velocity and no motion was read. The second case: the reasoning of the answering
    turn states a period that is longer than the total simulated time.
    """
    if not has_answered(episode):
        return None
    simulated = sum(step_duration(place) or 0.0 for place in exchanges(episode))
    about_motion = [
        place
        for place in exchanges(episode)
        # Results in the answering turn were not seen before the answer.
        if place.turn < answering_turn(episode) and succeeded(place) and place.tool in PUSHES | MOTION_READINGS
    ]
    if simulated < LEAST_TIME_S and about_motion and not any(map(shows_motion, about_motion)):
        return _before_motion(simulated, about_motion[-1])
    return _before_a_period(episode, simulated) if simulated > 0 else None


def _before_motion(simulated: float, last: Place) -> Failure:
    how_long = (
        f"after {simulated:.3g} s of simulated time, in which nothing moved" if simulated else "before time passed"
    )
    return Failure(
        mode=FailureMode.TOO_LITTLE_TIME,
        explanation=f"It judged motion {how_long}.",
        evidence=(
            Evidence(
                turn=last.turn,
                exchange=last.position,
                quote=last.tool,
                numbers={"simulated_s": simulated, "least_s": LEAST_TIME_S},
            ),
        ),
    )


def _before_a_period(episode: Episode, simulated: float) -> Failure | None:
    turn = answering_turn(episode)
    text = episode.turns[turn].reasoning
    for number in spoken_numbers(text):
        period = float(number.value)
        if number.unit == _SECOND and period > simulated and _PERIOD.search(text[: number.start]):
            return Failure(
                mode=FailureMode.TOO_LITTLE_TIME,
                explanation=f"It stated a period of {period:.3g} s after {simulated:.3g} s of simulated time.",
                evidence=(
                    Evidence(
                        turn=turn,
                        quote=quote_at(text, number.start),
                        numbers={"simulated_s": simulated, "period_s": period},
                    ),
                ),
            )
    return None


def answer_format(episode: Episode, grade: Grade, expected: ExpectedForm) -> Failure | None:
    """Answered in a form that the question does not ask for, and was strictly wrong.

    The forms: a right value that only normalised grading accepts, a wrong number of values, words where numbers were
    requested, or a choice that is not among the options.
    """
    if not has_answered(episode) or grade.strict is not Verdict.INCORRECT:
        return None
    why = _difference(episode, grade, expected)
    if not why:
        return None
    turn = answering_turn(episode)
    calls = [place.position for place in exchanges(episode) if place.turn == turn and place.tool == "answer"]
    return Failure(
        mode=FailureMode.ANSWER_FORMAT,
        explanation=f"It answered in another form than was asked for: {why}.",
        evidence=(Evidence(turn=turn, exchange=calls[-1] if calls else None, quote=quote_at(str(episode.answer))),),
    )


def _difference(episode: Episode, grade: Grade, expected: ExpectedForm) -> str:
    """How the form of an answer differs from the expected one; empty if it does not."""
    if grade.normalisation is not None:
        return f"right, but for its form ({grade.normalisation.value.replace('_', ' ')})"
    items = _items(episode.answer, expected)
    if items is None:
        return "one value was asked for" if expected.parts is None else f"{expected.parts} values were asked for"
    said = [str(item).strip().lower() for item in items]
    if expected.options:
        options = {option.strip().lower() for option in expected.options}
        return "" if options.issuperset(said) else "none of the options"
    if expected.kind is AnswerKind.OBJECTS:
        return "" if all(map(_OBJECT_ID.fullmatch, said)) else "no id of an object"
    if expected.is_numeric and any(plain_number(item) is None for item in items):
        return "words, where a number was asked for"
    return ""


def _items(answer: JsonValue, expected: ExpectedForm) -> list[Item] | None:
    """The parts of an answer; None if their number is not the expected one."""
    if expected.parts is None:
        item = as_item(answer)
        return None if item is None else [item]
    items = strict_items(answer)
    return items if items is not None and len(items) == expected.parts else None
