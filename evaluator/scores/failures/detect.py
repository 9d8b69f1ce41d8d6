"""Runs all failure detectors on one episode. Contains the detector that compares reasoning with readings.

That detector searches the reasoning for phrases, because only the agent's words show what it relied on.
"""

import re
from typing import NamedTuple

from evaluator.records.episode import Episode, Grade, Verdict
from evaluator.scores.failures.answering import answer_format, premature_answer, too_little_time
from evaluator.scores.failures.calling import object_id_confusion, wrong_parameter
from evaluator.scores.failures.findings import (
    ACTIONS,
    STEP,
    Evidence,
    ExpectedForm,
    Failure,
    FailureMode,
    answering_turn,
    exchanges,
    has_answered,
    quote_at,
    read_before_answer,
)

_FEWEST_WORDS = 5
"""Smallest number of words that counts as a theory; a shorter text is a guess."""
_SET_ASIDE = re.compile(
    r"\btheoretical(?:ly)? (?:approach|answer|value|analysis|result|calculation|physics|expectation)|"
    r"\bcalculate\b[^.\n]{0,40}\btheoretically|\banalytical(?:ly)?\b|\bconceptual(?:ly)? |\btextbook|"
    r"\bclassic(?:al)? (?:answer|result|problem|interpretation)|\bstandard (?:answer|assumption|problem|value)|"
    r"\btypical(?:ly)? (?:answer|value|problem|simulation|assum\w+|is|are|has|around|used)|"
    r"\bbased on (?:the )?(?:pure |known |standard |general )?(?:physics|theory|problem (?:setup|statement))|"
    r"\bphysics (?:principles?|calculations?|theory|dictates|reasoning|laws?)|\benergy principles|"
    r"\bassum(?:e|ing) (?:a |an |the |that )?(?:standard|typical|similar|default|\\?\(|[\w\\]+ ?(?:=|≈))|"
    r"\bi(?:'ll| will)? assume\b|\bdefaults?\b[^.\n]{0,30}\bfriction|\bmujoco(?:'s)? defaults?|"
    r"\b(?:don't|do not) need (?:a |the )?(?:physical )?simulation|"
    r"\bno (?:\w+ )?simulation (?:is )?(?:needed|necessary|required)|"
    r"\b(?:using|use|rely on) the (?:problem's )?given (?:values?|parameters)|"
    r"\bgiven (?:values?|parameters) (?:in|from)\b",
    re.IGNORECASE,
)
"""Phrases that show an answer from theory despite experiments."""
_BY_NAME = re.compile(
    r"\b(?:given|based on|from|by|using|use|per) (?:the )?(?:objects?'? )?(?:names?|naming|labels?)\b|"
    r"\b(?:names?|naming)\b[^.\n]{0,40}\b(?:indicat|impl(?:y|ies)|suggest|tell)|\bimplied by (?:the )?names?|"
    r"\bexplicitly (?:names?|named|labels?|labell?ed)\b",
    re.IGNORECASE,
)
"""Phrases that show an answer taken from the names of objects."""
_AGREES = re.compile(
    r"\b(?:match(?:es|ed|ing)?|confirm(?:s|ed|ing)?|agree(?:s|d)?|consistent|verif(?:y|ies|ied)|validat\w+)\b"
    r"[^.\n]{0,40}\btheor|\btheor\w+\b[^.\n]{0,30}\b(?:confirmed|matched|verified)",
    re.IGNORECASE,
)
_DOUBTED = re.compile(
    r"\bcontradict|\bcounter-?intuitive|\bunexpected(?:ly)? |\bcontrary to|\bunusual\b|\banomal|\bunrealistic|"
    r"\bshould\b(?:(?!should\b)[^.\n]){0,160}?[.…,;] ?(?:however|but|yet)\b[^.\n]{0,12}"
    r"\b(?:simulat\w+|measure\w+|readings?|results?|data)\b[^.\n]{0,20}\b(?:indicate|show|suggest|sa(?:y|id)|reveal|give)|"
    r"\bexpected\b[^.\n]{0,12}\.? but (?:got|measured)|\bphysically impossible|\bnot modell?ed|\bdespite the name",
    re.IGNORECASE,
)


class _Cue(NamedTuple):
    turn: int
    start: int


def theory_or_simulation(episode: Episode) -> Failure | None:
    """Detect an answer from theory without or against the readings, or from readings that the agent doubted.

    Theory: an answer with reasoning before any reading; an answer from formulas, assumptions or textbooks after an
    experiment; or an answer taken from the names of objects. Doubt: within the last three turns the reasoning calls the
    readings unexpected, and the agent still answers from them.
    """
    if not has_answered(episode):
        return None
    turn = answering_turn(episode)
    text = episode.turns[turn].reasoning
    if read_before_answer(episode):
        return _from_theory(episode, turn, text) or _from_doubted_readings(episode, turn, text)
    if len(text.split()) < _FEWEST_WORDS:
        return None
    return _failure("It answered from theory, without a reading.", _Cue(turn, 0), episode)


def _from_theory(episode: Episode, turn: int, text: str) -> Failure | None:
    if _AGREES.search(text):
        return None
    by_name, cue = _first(_BY_NAME, text), _first(_SET_ASIDE, text)
    if by_name is not None and _first(_DOUBTED, text) is None:
        return _failure("It answered from what the objects are called.", _Cue(turn, by_name), episode)
    if cue is not None and _tried(episode):
        return _failure("It set aside what it tried and answered from theory.", _Cue(turn, cue), episode)
    return None


def _from_doubted_readings(episode: Episode, turn: int, text: str) -> Failure | None:
    if _first(_SET_ASIDE, text) is not None and not _AGREES.search(text):
        return None  # the answer is from theory, not from the doubted readings
    for number in range(turn, max(-1, turn - 3), -1):
        doubt = _first(_DOUBTED, episode.turns[number].reasoning)
        if doubt is not None:
            return _failure("It answered from readings that it had called unexpected.", _Cue(number, doubt), episode)
    return None


def _tried(episode: Episode) -> bool:
    """Whether an action or step was attempted before the answering turn."""
    last = len(episode.turns) - 1
    return any(
        place.turn < last and (place.tool in ACTIONS or place.tool == STEP or place.exchange.is_error)
        for place in exchanges(episode)
    )


def _first(pattern: re.Pattern[str], text: str) -> int | None:
    found = pattern.search(text)
    return found.start() if found else None


def _failure(explanation: str, cue: _Cue, episode: Episode) -> Failure:
    readings = len(read_before_answer(episode))
    return Failure(
        mode=FailureMode.THEORY_OR_SIMULATION,
        explanation=explanation,
        evidence=(
            Evidence(
                turn=cue.turn,
                quote=quote_at(episode.turns[cue.turn].reasoning, cue.start),
                numbers={"readings": readings},
            ),
        ),
    )


def failures_of(episode: Episode, grade: Grade, expected: ExpectedForm) -> tuple[Failure, ...]:
    """Detect the failures of an episode, at most one of each mode; none if the episode is unscored.

    Args:
        episode: The recorded episode.
        grade: Its grade.
        expected: The form of answer that the question asks for.
    """
    if grade.strict is Verdict.UNSCORED:
        return ()
    found = (
        premature_answer(episode, grade),
        too_little_time(episode),
        answer_format(episode, grade, expected),
        object_id_confusion(episode, grade, expected),
        wrong_parameter(episode, grade),
        theory_or_simulation(episode),
    )
    return tuple(failure for failure in found if failure is not None)
