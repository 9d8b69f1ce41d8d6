"""Counts the results of the published logs for each model. The report contains counts but no text of the logs."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pydantic import JsonValue

from evaluator.episode.player import ANSWER
from evaluator.episode.protocols.text import parse_reply
from evaluator.original.play import PlayedLog, eq1, why_other_than_eq1, why_other_verdict
from evaluator.records.episode import Episode, Exchange, Outcome, Record, Verdict
from evaluator.report.export import markdown_table

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
    """Counts of replies by how they were parsed."""

    replies: int = 0
    read_by_them: int = 0
    with_calls: int = 0
    empty: int = 0
    without_calls: int = 0
    """Replies with prose only."""
    malformed: int = 0

    @property
    def written(self) -> int:
        """Number of replies with any text."""
        return self.replies - self.empty


class Calls(Record):
    """Counts of the calls in the parsed replies by outcome."""

    executed: int = 0
    refused: int = 0
    """Ran and returned an error."""
    misfitting: int = 0
    """Not run, because they fit no tool's schema."""
    not_run: int = 0
    """Not run, because they followed an answer or a call that fits no schema."""


class Verdicts(Record):
    """Counts of verdicts for the episodes that have one in the log; `eq1_right` counts only numeric answers."""

    logged: int = 0
    logged_right: int = 0
    strict_right: int = 0
    normalised_right: int = 0
    numeric: int = 0
    """Episodes to which Eq. 1 applies: both answer and key are numbers."""
    numeric_logged_right: int = 0
    numeric_strict_right: int = 0
    eq1_right: int = 0
    unlogged: int = 0
    """Episodes with replies but without a verdict in the log."""
    unlogged_answered: int = 0
    unlogged_strict_right: int = 0


class Row(Record):
    """Counts for one model at one budget, or for all episodes."""

    model: str
    budget: int | None
    episodes: int
    crashed: int
    """Episodes whose last reply crashed the authors' program."""
    crashed_readable: int
    """Crashed episodes whose last reply has calls that we can parse."""
    not_played: int
    """Number of episodes for which this project's server failed."""
    replies: Replies
    calls: Calls
    verdicts: Verdicts
    disagreements: dict[str, int]
    """Reason why the log's verdict differs from this project's → number of episodes."""
    scenes: dict[str, tuple[int, ...]]
    """Reason → scenes in which it occurred."""
    eq1_disagreements: dict[str, int]
    """Reason why Eq. 1 and the strict verdict differ → number of episodes."""


@dataclass(frozen=True, slots=True)
class Compared:
    """A replayed log, with its verdict compared with this project's verdict and with Eq. 1."""

    played: PlayedLog
    answer: JsonValue
    strict: bool
    normalised: bool
    by_eq1: bool | None
    disagreement: str
    eq1_disagreement: str


def compare(played: PlayedLog) -> Compared:
    """Compare the verdict of a log with this project's verdict and with Eq. 1."""
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
    """Return one row for each model and budget, and one row for all."""
    groups: dict[tuple[str, int], list[Compared]] = {}
    for result in compared:
        groups.setdefault((result.played.log.model, result.played.log.budget), []).append(result)
    listed = [_row(model, budget, group) for (model, budget), group in groups.items()]
    return [*listed, _row("all", None, compared)] if len(listed) > 1 else listed


def _row(model: str, budget: int | None, group: Sequence[Compared]) -> Row:
    reasons = Counter(result.disagreement for result in group if result.disagreement)
    return Row(
        model=model,
        budget=budget,
        episodes=len(group),
        crashed=sum(result.played.log.crashed for result in group),
        crashed_readable=sum(
            result.played.log.crashed and bool(parse_reply(result.played.log.replies[-1]).calls) for result in group
        ),
        not_played=sum(bool(result.played.failure) for result in group),
        replies=_replies(group),
        calls=_calls(result.played.episode for result in group if result.played.episode),
        verdicts=_verdicts(group),
        disagreements=dict(reasons.most_common()),
        scenes={
            reason: tuple(sorted({result.played.scene for result in group if result.disagreement == reason}))
            for reason in reasons
        },
        eq1_disagreements=dict(
            Counter(result.eq1_disagreement for result in group if result.eq1_disagreement).most_common()
        ),
    )


def _replies(group: Sequence[Compared]) -> Replies:
    texts = [text for result in group for text in result.played.log.replies]
    read = [parse_reply(text) for text in texts]
    return Replies(
        replies=len(texts),
        read_by_them=sum(result.played.log.read for result in group),
        with_calls=sum(bool(reply.calls) for reply in read),
        empty=sum(not text for text in texts),
        without_calls=sum(
            bool(text) and not reply.calls and not reply.malformed for text, reply in zip(texts, read, strict=True)
        ),
        malformed=sum(bool(reply.malformed) for reply in read),
    )


def _calls(episodes: Iterable[Episode]) -> Calls:
    kinds = Counter(_kind(exchange) for episode in episodes for turn in episode.turns for exchange in turn.exchanges)
    return Calls(**kinds)


def _kind(exchange: Exchange) -> str:
    if exchange.returned:
        return "refused" if exchange.is_error else "executed"
    return "misfitting" if exchange.is_error else "not_run"


def _verdicts(group: Sequence[Compared]) -> Verdicts:
    logged = [result for result in group if result.played.log.verdict]
    numeric = [result for result in logged if result.by_eq1 is not None]
    unlogged = [result for result in group if not result.played.log.verdict]
    return Verdicts(
        logged=len(logged),
        logged_right=sum(_marked_right(result) for result in logged),
        strict_right=sum(result.strict for result in logged),
        normalised_right=sum(result.normalised for result in logged),
        numeric=len(numeric),
        numeric_logged_right=sum(_marked_right(result) for result in numeric),
        numeric_strict_right=sum(result.strict for result in numeric),
        eq1_right=sum(bool(result.by_eq1) for result in numeric),
        unlogged=len(unlogged),
        unlogged_answered=sum(_answered(result) for result in unlogged),
        unlogged_strict_right=sum(result.strict for result in unlogged),
    )


def _marked_right(compared: Compared) -> bool:
    return compared.played.log.verdict is not None and compared.played.log.verdict.right


def _answered(compared: Compared) -> bool:
    episode = compared.played.episode
    return episode is not None and episode.outcome is Outcome.ANSWERED and _ends_in_answer(episode)


def _ends_in_answer(episode: Episode) -> bool:
    return any(exchange.call.tool == ANSWER and exchange.returned for exchange in episode.turns[-1].exchanges)


def markdown(rows: Sequence[Row]) -> str:
    """Format the report: parsing of replies, outcomes of calls, verdicts, and reasons for differences."""
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


def _verdict_cells(verdicts: Verdicts) -> tuple[int, ...]:
    return (
        verdicts.logged,
        verdicts.logged_right,
        verdicts.strict_right,
        verdicts.normalised_right,
        verdicts.numeric,
        verdicts.numeric_logged_right,
        verdicts.eq1_right,
        verdicts.numeric_strict_right,
        verdicts.unlogged,
        verdicts.unlogged_answered,
        verdicts.unlogged_strict_right,
    )


def _who(row: Row) -> tuple[str, str]:
    return row.model, "all" if row.budget is None else str(row.budget or "?")


def _share(part: int, whole: int) -> str:
    return f"{part} ({part / whole:.1%})" if whole else str(part)


def _table(titles: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    return markdown_table(titles, [[str(cell) for cell in cells] for cells in rows]) + "\n"
