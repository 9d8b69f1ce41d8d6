"""Detectors of failures in the answer: given too early, in the wrong form, or after too little simulated time."""

import re
from collections.abc import Sequence

from pydantic import JsonValue

from evaluator.answers.forms import Item, as_item, plain_number, strict_items
from evaluator.quantities.spoken import spoken_numbers
from evaluator.quantities.units import parse_unit
from evaluator.records.episode import Episode, Grade, Verdict
from evaluator.scores.failures.findings import (
    ACTIONS,
    MOTION_READINGS,
    PUSHES,
    Evidence,
    ExpectedForm,
    Failure,
    FailureMode,
    Place,
    answering_turn,
    exchanges,
    has_answered,
    measured_numbers,
    quote_at,
    read_before_answer,
    shows_motion,
    step_duration,
    succeeded,
)
from scenes import AnswerKind

LEAST_TIME_S = 0.1
"""Simulated time below which an answer about motion counts as premature: 20 time steps of 5 ms [s]."""

_PERIOD = re.compile(r"\bperiod\b[^.\n]{0,24}$", re.IGNORECASE)
_EQUALS = r"(?:=|≈|\\approx)"
_TERM = r"(?:(?!\\approx)[^\n=≈]){0,40}"
_PERIOD_BY_FORMULA = re.compile(rf"\bT ?{_EQUALS}{_TERM}(?:{_EQUALS}{_TERM})?{_EQUALS} ?$")
_LATEX = re.compile(r"\\(?:text|mathrm|rm) ?\{([^{}]{0,40})\}|\$|\\[(),; ]")
"""Typesetting commands between a number and its unit; text in braces is kept."""
_FROM_GEOMETRY = re.compile(
    r"\bfrom (?:the )?(?:static |initial |given )?(?:geometry|positions?|coordinates)\b", re.IGNORECASE
)
_SECOND = parse_unit("s")
_OBJECT_ID = re.compile(r"object_\d+|\d+")


def premature_answer(episode: Episode, grade: Grade) -> Failure | None:
    """Detect an answer with iterations left that was given without a reading, or from the initial state alone.

    In the first case, the agent had seen no successful reading. In the second case, at least half of the iterations
    were left, the answer was strictly wrong, and the agent changed nothing, let time pass, and either read nothing
    afterwards or answered from its readings of the initial state. Readings in the same batch as the answer do not
    count, because the agent had not seen them.
    """
    left = episode.allowance - len(episode.turns)
    if not has_answered(episode) or left <= 0:
        return None
    readings = read_before_answer(episode)
    is_early = 2 * left >= episode.allowance and grade.strict is Verdict.INCORRECT
    if readings and not (is_early and _knows_only_the_start(episode, readings)):
        return None
    turn = answering_turn(episode)
    turns = "iterations" if episode.max_calls is None else "calls"
    when = "from readings of the start alone" if readings else "before any reading"
    return Failure(
        mode=FailureMode.PREMATURE_ANSWER,
        explanation=f"It answered with {left} of {episode.allowance} {turns} left, {when}.",
        evidence=(
            Evidence(
                turn=turn,
                quote=quote_at(episode.turns[turn].reasoning),
                numbers={f"{turns}_used": len(episode.turns), "budget": episode.allowance, "readings": len(readings)},
            ),
        ),
    )


def _knows_only_the_start(episode: Episode, readings: Sequence[Place]) -> bool:
    """Whether the agent only let time pass, and either read nothing afterwards or did not use those readings."""
    steps = [(place.turn, place.position) for place in exchanges(episode) if step_duration(place)]
    acted = any(place.tool in ACTIONS and succeeded(place) for place in exchanges(episode))
    if not steps or acted:
        return False
    before = [place for place in readings if (place.turn, place.position) < steps[0]]
    after = [place for place in readings if (place.turn, place.position) > steps[0]]
    return not after or (bool(before) and _uses_the_start(episode.turns[-1].reasoning, before, after))


def _uses_the_start(text: str, before: Sequence[Place], after: Sequence[Place]) -> bool:
    """Whether the reasoning refers to geometry, or repeats initial readings and no later ones."""
    if _FROM_GEOMETRY.search(text):
        return True
    start = {abs(value) for place in before for value in measured_numbers(place)} - {0.0}
    later = {abs(value) for place in after for value in measured_numbers(place)}
    said = [(abs(float(number.value)), float(number.half_unit)) for number in spoken_numbers(text)]
    from_start = [(value, half) for value, half in said if any(abs(value - read) <= half for read in start)]
    others = [(value, half) for value, half in said if (value, half) not in from_start]
    return bool(from_start) and not any(abs(value - read) <= half for value, half in others for read in later)


def too_little_time(episode: Episode) -> Failure | None:
    """Detect an answer about motion before anything moved, or a period in the reasoning longer than the simulated time.

    In the first case, less than `LEAST_TIME_S` was simulated in total, and either every reading of motion was 0, or
    something was pushed or given a velocity and no motion was read. In the second case, the reasoning of the answering
    turn states a period that is longer than the total simulated time. A period written as T = … counts only if nothing
    moved.
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
    patterns = [_PERIOD]
    if about_motion and not any(map(shows_motion, about_motion)):
        patterns.append(_PERIOD_BY_FORMULA)
    return _before_a_period(episode, simulated, patterns) if simulated > 0 else None


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


def _before_a_period(episode: Episode, simulated: float, patterns: Sequence[re.Pattern[str]]) -> Failure | None:
    turn = answering_turn(episode)
    text = _LATEX.sub(lambda found: found[1] or "", episode.turns[turn].reasoning)
    for number in spoken_numbers(text):
        period = float(number.value)
        if (
            number.unit == _SECOND
            and period > simulated
            and any(pattern.search(text[: number.start]) for pattern in patterns)
        ):
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
    """Detect a strictly wrong answer whose form differs from what the question asks for.

    The forms are a right value that only normalised grading accepts, a wrong number of values, words instead of
    numbers, a choice that is not among the options, and a quantity instead of the number of an object or a case. If
    the prompt asks a different question than the pack, nothing is detected, because the expected form was not
    requested.
    """
    if not has_answered(episode) or grade.strict is not Verdict.INCORRECT or not expected.was_asked(episode.prompt):
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
    """Describe how the form of an answer differs from the expected one; empty if it does not."""
    if grade.normalisation is not None:
        return f"right, but for its form ({grade.normalisation.value.replace('_', ' ')})"
    items = _items(episode.answer, expected)
    if items is None:
        return "one value was asked for" if expected.parts is None else f"{expected.parts} values were asked for"
    said = [str(item).strip().lower() for item in items]
    options = {option.strip().lower() for option in expected.options}
    numbers = [plain_number(item) for item in items]
    is_quantity = any(number is not None and number.value != int(number.value) for number in numbers)
    reasons = (
        ("none of the options", bool(options) and not options.issuperset(said)),
        (
            "a quantity, where the number of an object or a case was asked for",
            expected.kind is AnswerKind.CHOICE and not options and is_quantity,
        ),
        ("no id of an object", expected.kind is AnswerKind.OBJECTS and not all(map(_OBJECT_ID.fullmatch, said))),
        (
            "words, where a number was asked for",
            not options and expected.kind is not AnswerKind.OBJECTS and expected.is_numeric and None in numbers,
        ),
    )
    return next((reason for reason, holds in reasons if holds), "")


def _items(answer: JsonValue, expected: ExpectedForm) -> list[Item] | None:
    """Split an answer into its parts; None if it has more or fewer parts than expected."""
    if expected.parts is None:
        item = as_item(answer)
        return None if item is None else [item]
    items = strict_items(answer)
    return items if items is not None and len(items) == expected.parts else None
