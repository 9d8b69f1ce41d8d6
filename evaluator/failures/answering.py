"""Detectors that look at the answer: given too early, in the wrong form, after too little simulated time."""

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
from evaluator.failures.findings import AnswerForm, Evidence, Failure, FailureMode, answering_turn, quote_at
from evaluator.quantities.spoken import spoken_numbers
from evaluator.quantities.units import parse_unit
from evaluator.records import Episode, Grade, Verdict
from scenes.pack import AnswerKind

LEAST_TIME_S = 0.1
"""Simulated time below which a judgement of motion is held to be rash [s]: 20 of the suite's time steps of 5 ms."""

_PERIOD = re.compile(r"\bperiod\b[^.\n]{0,24}$", re.IGNORECASE)
_SECOND = parse_unit("s")
_OBJECT_ID = re.compile(r"object_\d+|\d+")


def premature_answer(episode: Episode) -> Failure | None:
    """Answered, with iterations left, before the return of any successful reading had been read.

    Readings in the same batch as the answer do not count: the agent had not seen them.
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
    """Judged motion before there was any, or a period before it was over.

    The first: less than `LEAST_TIME_S` was simulated in all, and either everything read of motion was 0, or something
    was pushed or given a speed and nothing read of it. The second: the reasoning of the answer tells a period that is
    longer than all simulated time.
    """
    if not has_answered(episode):
        return None
    simulated = sum(step_duration(one) or 0.0 for one in exchanges(episode))
    about_motion = [
        one
        for one in exchanges(episode)
        # What stands beside the answer was not read before it.
        if one.turn < answering_turn(episode) and succeeded(one) and one.tool in PUSHES | MOTION_READINGS
    ]
    if simulated < LEAST_TIME_S and about_motion and not any(map(shows_motion, about_motion)):
        return _rash(simulated, about_motion[-1])
    return _less_than_a_period(episode, simulated) if simulated > 0 else None


def _rash(simulated: float, last: Place) -> Failure:
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


def _less_than_a_period(episode: Episode, simulated: float) -> Failure | None:
    turn = answering_turn(episode)
    text = episode.turns[turn].reasoning
    for number in spoken_numbers(text):
        period = float(number.value)
        if number.unit == _SECOND and period > simulated and _PERIOD.search(text[: number.start]):
            return Failure(
                mode=FailureMode.TOO_LITTLE_TIME,
                explanation=f"It told a period of {period:.3g} s after {simulated:.3g} s of simulated time.",
                evidence=(
                    Evidence(
                        turn=turn,
                        quote=quote_at(text, number.start),
                        numbers={"simulated_s": simulated, "period_s": period},
                    ),
                ),
            )
    return None


def answer_format(episode: Episode, grade: Grade, form: AnswerForm) -> Failure | None:
    """Answered, strictly wrong, in a form that the question does not ask for.

    A right value in another form (normalised grading forgives it), a wrong count of values, words for numbers, or a
    choice that is none of the options.
    """
    if not has_answered(episode) or grade.strict is not Verdict.INCORRECT:
        return None
    why = _misfit(episode, grade, form)
    if not why:
        return None
    turn = answering_turn(episode)
    calls = [one.position for one in exchanges(episode) if one.turn == turn and one.tool == "answer"]
    return Failure(
        mode=FailureMode.ANSWER_FORMAT,
        explanation=f"It answered in another form than was asked for: {why}.",
        evidence=(Evidence(turn=turn, exchange=calls[-1] if calls else None, quote=quote_at(str(episode.answer))),),
    )


def _misfit(episode: Episode, grade: Grade, form: AnswerForm) -> str:
    """How the form of an answer differs from the one asked for; empty if it does not."""
    if grade.normalisation is not None:
        return f"right, but for its form ({grade.normalisation.value.replace('_', ' ')})"
    items = _items(episode.answer, form)
    if items is None:
        return "one value was asked for" if form.parts is None else f"{form.parts} values were asked for"
    said = [str(one).strip().lower() for one in items]
    if form.options:
        options = {one.strip().lower() for one in form.options}
        return "" if options.issuperset(said) else "none of the options"
    if form.kind is AnswerKind.OBJECTS:
        return "" if all(_OBJECT_ID.fullmatch(one) for one in said) else "no id of an object"
    if form.is_numeric and any(plain_number(one) is None for one in items):
        return "words, where a number was asked for"
    return ""


def _items(answer: JsonValue, form: AnswerForm) -> list[Item] | None:
    """The parts of an answer; None where it has not as many as were asked for."""
    if form.parts is None:
        item = as_item(answer)
        return None if item is None else [item]
    items = strict_items(answer)
    return items if items is not None and len(items) == form.parts else None
