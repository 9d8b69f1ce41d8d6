"""Counting what came of the published logs, model by model, and the report of it: figures, no text of the logs."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pydantic import JsonValue

from evaluator.episode.player import ANSWER
from evaluator.markdown import markdown_table
from evaluator.original.play import PlayedLog
from evaluator.original.verdicts import eq1, why_other_than_eq1, why_other_verdict
from evaluator.protocols.text import parse_reply
from evaluator.records import Episode, Exchange, Outcome, Record, Verdict

_READING = (
    *("model", "budget", "episodes", "replies", "empty", "read by them", "read by us", "prose alone", "malformed"),
    *("their crashes", "of these readable"),
)
_CALLING = ("model", "budget", "calls", "executed", "refused", "misfitting", "not run")
_JUDGING = (
    *("model", "budget", "with a logged verdict", "right by the log", "strictly right", "right if normalised"),
    *("numbers", "numbers right by the log", "by Eq. 1", "strictly", "no logged verdict", "answered", "strictly right"),
)


class Replies(Record):
    """How replies were read."""

    replies: int = 0
    read_by_them: int = 0
    with_calls: int = 0
    empty: int = 0
    without_calls: int = 0
    """Prose alone."""
    malformed: int = 0

    @property
    def written(self) -> int:
        """Replies that hold any text."""
        return self.replies - self.empty


class Calls(Record):
    """What came of the calls in the replies that were read."""

    executed: int = 0
    refused: int = 0
    """Run, and answered with an error."""
    misfitting: int = 0
    """Fits no tool's schema; was not run."""
    not_run: int = 0
    """Stood after an answer or after a call that fits no schema."""


class Verdicts(Record):
    """Verdicts on the episodes that have one in the log; `eq1` counts numbers alone."""

    logged: int = 0
    logged_right: int = 0
    strict_right: int = 0
    normalised_right: int = 0
    numeric: int = 0
    """Answers to which Eq. 1 applies: numbers, with a key of numbers."""
    numeric_logged_right: int = 0
    numeric_strict_right: int = 0
    eq1_right: int = 0
    unlogged: int = 0
    """Episodes with replies but without a verdict in the log."""
    unlogged_answered: int = 0
    unlogged_strict_right: int = 0


class Row(Record):
    """One model at one budget, or the sum of all."""

    model: str
    budget: int | None
    episodes: int
    crashed: int
    """Episodes on whose last reply the authors' program died."""
    crashed_readable: int
    """Those of them whose last reply holds calls that we can read."""
    not_played: int
    """Episodes that our laboratory failed on."""
    replies: Replies
    calls: Calls
    verdicts: Verdicts
    disagreements: dict[str, int]
    """Why the log's verdict is another than ours → how often."""
    scenes: dict[str, tuple[int, ...]]
    """Why → in which scenes."""
    eq1_disagreements: dict[str, int]
    """Why Eq. 1 and our strict verdict differ → how often."""


@dataclass(frozen=True, slots=True)
class Compared:
    """One played log with the comparison of its verdicts."""

    played: PlayedLog
    answer: JsonValue
    strict: bool
    normalised: bool
    by_eq1: bool | None
    disagreement: str
    eq1_disagreement: str


def compare(played: PlayedLog) -> Compared:
    """Hold the verdict of a log against ours and against Eq. 1."""
    answer = played.episode.answer if played.episode else None
    key: JsonValue = list(played.key) if isinstance(played.key, tuple) else played.key
    strict = played.grade is not None and played.grade.strict is Verdict.CORRECT
    normalised = played.grade is not None and played.grade.normalised is Verdict.CORRECT
    logged = played.log.verdict
    other = logged and why_other_verdict(logged, answer, key, strict=strict, normalised=normalised)
    by_eq1 = None if answer is None else eq1(answer, key)
    than_eq1 = None if by_eq1 is None else why_other_than_eq1(by_eq1, strict, key, is_choice=played.is_choice)
    return Compared(played, answer, strict, normalised, by_eq1, other or "", than_eq1 or "")


def rows(compared: Sequence[Compared]) -> list[Row]:
    """A row for each model and budget, and one for all."""
    groups: dict[tuple[str, int], list[Compared]] = {}
    for one in compared:
        groups.setdefault((one.played.log.model, one.played.log.budget), []).append(one)
    listed = [_row(model, budget, group) for (model, budget), group in groups.items()]
    return [*listed, _row("all", None, compared)] if len(listed) > 1 else listed


def _row(model: str, budget: int | None, group: Sequence[Compared]) -> Row:
    whys = Counter(one.disagreement for one in group if one.disagreement)
    return Row(
        model=model,
        budget=budget,
        episodes=len(group),
        crashed=sum(one.played.log.crashed for one in group),
        crashed_readable=sum(
            one.played.log.crashed and bool(parse_reply(one.played.log.replies[-1]).calls) for one in group
        ),
        not_played=sum(bool(one.played.failure) for one in group),
        replies=_replies(group),
        calls=_calls(one.played.episode for one in group if one.played.episode),
        verdicts=_verdicts(group),
        disagreements=dict(whys.most_common()),
        scenes={why: tuple(sorted({one.played.scene for one in group if one.disagreement == why})) for why in whys},
        eq1_disagreements=dict(Counter(one.eq1_disagreement for one in group if one.eq1_disagreement).most_common()),
    )


def _replies(group: Sequence[Compared]) -> Replies:
    texts = [text for one in group for text in one.played.log.replies]
    read = [parse_reply(text) for text in texts]
    return Replies(
        replies=len(texts),
        read_by_them=sum(one.played.log.read for one in group),
        with_calls=sum(bool(reply.calls) for reply in read),
        empty=sum(not text for text in texts),
        without_calls=sum(
            bool(text) and not reply.calls and not reply.malformed for text, reply in zip(texts, read, strict=True)
        ),
        malformed=sum(bool(reply.malformed) for reply in read),
    )


def _calls(episodes: Iterable[Episode]) -> Calls:
    kinds = Counter(_kind(one) for episode in episodes for turn in episode.turns for one in turn.exchanges)
    return Calls(**kinds)


def _kind(exchange: Exchange) -> str:
    if exchange.returned:
        return "refused" if exchange.is_error else "executed"
    return "misfitting" if exchange.is_error else "not_run"


def _verdicts(group: Sequence[Compared]) -> Verdicts:
    logged = [one for one in group if one.played.log.verdict]
    numeric = [one for one in logged if one.by_eq1 is not None]
    unlogged = [one for one in group if not one.played.log.verdict]
    return Verdicts(
        logged=len(logged),
        logged_right=sum(_marked_right(one) for one in logged),
        strict_right=sum(one.strict for one in logged),
        normalised_right=sum(one.normalised for one in logged),
        numeric=len(numeric),
        numeric_logged_right=sum(_marked_right(one) for one in numeric),
        numeric_strict_right=sum(one.strict for one in numeric),
        eq1_right=sum(bool(one.by_eq1) for one in numeric),
        unlogged=len(unlogged),
        unlogged_answered=sum(_answered(one) for one in unlogged),
        unlogged_strict_right=sum(one.strict for one in unlogged),
    )


def _marked_right(one: Compared) -> bool:
    return one.played.log.verdict is not None and one.played.log.verdict.right


def _answered(one: Compared) -> bool:
    episode = one.played.episode
    return episode is not None and episode.outcome is Outcome.ANSWERED and _ends_in_answer(episode)


def _ends_in_answer(episode: Episode) -> bool:
    return any(one.call.tool == ANSWER and one.returned for one in episode.turns[-1].exchanges)


def markdown(rows: Sequence[Row]) -> str:
    """The report: how replies were read, what came of the calls, the verdicts, and why they differ."""
    total = rows[-1]
    heads = [f"{row.model} {row.budget or ''}".rstrip() for row in rows]
    return "\n".join(
        (
            _table(_READING, [(*_who(row), *_reading_cells(row)) for row in rows]),
            _table(_CALLING, [(*_who(row), *_calling_cells(row.calls)) for row in rows]),
            _table(_JUDGING, [(*_who(row), *_verdict_cells(row.verdicts)) for row in rows]),
            _table(
                ("why the log's verdict is another than ours", *heads, "scenes"),
                [
                    (why, *(row.disagreements.get(why, 0) for row in rows), ", ".join(map(str, total.scenes[why])))
                    for why in total.disagreements
                ],
            ),
            _table(
                ("why our strict verdict is another than that of Eq. 1", *heads),
                [(why, *(row.eq1_disagreements.get(why, 0) for row in rows)) for why in total.eq1_disagreements],
            ),
        )
    )


def _reading_cells(row: Row) -> tuple[object, ...]:
    read = row.replies
    return (
        row.episodes,
        read.replies,
        read.empty,
        _share(read.read_by_them, read.written),
        _share(read.with_calls, read.written),
        read.without_calls,
        read.malformed,
        row.crashed,
        row.crashed_readable,
    )


def _calling_cells(calls: Calls) -> tuple[int, ...]:
    counts = (calls.executed, calls.refused, calls.misfitting, calls.not_run)
    return (sum(counts), *counts)


def _verdict_cells(one: Verdicts) -> tuple[int, ...]:
    return (
        one.logged,
        one.logged_right,
        one.strict_right,
        one.normalised_right,
        one.numeric,
        one.numeric_logged_right,
        one.eq1_right,
        one.numeric_strict_right,
        one.unlogged,
        one.unlogged_answered,
        one.unlogged_strict_right,
    )


def _who(row: Row) -> tuple[str, str]:
    return row.model, "all" if row.budget is None else str(row.budget or "?")


def _share(part: int, whole: int) -> str:
    return f"{part} ({part / whole:.1%})" if whole else str(part)


def _table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    return markdown_table(titles, [[str(cell) for cell in cells] for cells in rows]) + "\n"
