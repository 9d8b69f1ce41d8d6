"""The detector that holds reasoning against readings: theory over simulation, or the reverse.

What an agent relied on shows in its words alone. What the words looked for miss and mistake is measured, on logs that
had no part in choosing them, in docs/explanation/failure-modes.md.
"""

import re
from typing import NamedTuple

from evaluator.failures.course import DEEDS, STEP, exchanges, has_answered, read_before_answer
from evaluator.failures.findings import Evidence, Failure, FailureMode, answering_turn, quote_at
from evaluator.records import Episode

_SET_ASIDE = re.compile(
    r"\btheoretical (?:approach|answer|value|analysis|result)|\btheoretical physics|"
    r"\bcalculate\b[^.\n]{0,30}\btheoretically|"
    r"\b(?:calculat|comput|reason|solv|deriv|determin)\w*\b[^.\n]{0,40}\banalytically|\banalytically\b|"
    r"\btextbook|\bclassic(?:al)? (?:answer|result|problem|interpretation)|\btypical (?:answer|value|problem)|"
    r"\bbased on (?:(?:the )?(?:object )?names|(?:pure )?(?:physics|theory)|(?:known|standard|general) \w+|"
    r"(?:the )?(?:physics|physical) (?:principles?|laws?))|\bphysics principles?|\bphysics dictates|"
    r"\b(?:use|using) the (?:object )?names|\bnames? [^.\n]{0,40}\bimpl(?:y|ies)|"
    r"\bi(?:'ll| will)? assume\b|\bassuming? (?:a |an |the )?(?:standard|typical|similar|\\?\(|[\w\\]+ ?(?:=|≈))|"
    r"\bstandard assumption|\b(?:don't|do not) need (?:a |the )?(?:physical )?simulation|"
    r"\bno (?:\w+ )?simulation (?:is )?(?:needed|necessary|required)",
    re.IGNORECASE,
)
_AGREES = re.compile(
    r"\b(?:match(?:es|ed|ing)?|confirm(?:s|ed|ing)?|agree(?:s|d)?|consistent|verif(?:y|ies|ied))\b[^.\n]{0,40}\btheor|"
    r"\btheor\w+\b[^.\n]{0,30}\b(?:confirmed|matched|verified)",
    re.IGNORECASE,
)
_DOUBTED = re.compile(
    r"\bcontradict|\bcounter-?intuitive|\bunexpected(?:ly)? (?:result|behavio|position|value|outcome)|"
    r"\bexpected\b[^.\n]{0,12}\.? but (?:got|measured)|\bphysically impossible|\bnot modell?ed",
    re.IGNORECASE,
)


class _Cue(NamedTuple):
    turn: int
    start: int


def theory_or_simulation(episode: Episode) -> Failure | None:
    """Took the answer from theory without readings or after setting them aside, or from readings that it doubted.

    Theory: an answer with reasoning before any reading was read; or, after something was tried in the laboratory, an
    answer whose reasoning turns to formulas, assumptions, names or textbooks. Reverse: the reasoning calls the
    readings contrary to what is expected, within its last three turns, and answers from them all the same.
    """
    if not has_answered(episode):
        return None
    turn = answering_turn(episode)
    text = episode.turns[turn].reasoning
    if not read_before_answer(episode):
        return _failure("It answered from theory, without a reading.", _Cue(turn, 0), episode) if text.strip() else None
    cue = _first(_SET_ASIDE, text)
    if cue is not None and _tried(episode) and not _AGREES.search(text):
        return _failure("It set aside what it tried and answered from theory.", _Cue(turn, cue), episode)
    if cue is not None and not _AGREES.search(text):
        return None
    for number in range(turn, max(-1, turn - 3), -1):
        doubt = _first(_DOUBTED, episode.turns[number].reasoning)
        if doubt is not None:
            return _failure("It answered from readings that it had called unexpected.", _Cue(number, doubt), episode)
    return None


def _tried(episode: Episode) -> bool:
    """Tell whether something was done in the laboratory, or attempted, before the answering turn."""
    last = len(episode.turns) - 1
    return any(
        one.turn < last and (one.tool in DEEDS or one.tool == STEP or one.exchange.is_error)
        for one in exchanges(episode)
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
