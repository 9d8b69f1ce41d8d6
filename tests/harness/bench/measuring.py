"""Times two functions alternately in one run, and makes the table row that compares them."""

import statistics
import time
from collections.abc import Awaitable, Callable, Sequence
from typing import NamedTuple

Timed = Callable[[], Awaitable[float]]
"""Function that does the work once and returns its duration [s]."""
Work = Callable[[], object]
"""Function that does the work once."""


class Row(NamedTuple):
    """One comparison."""

    what: str
    ours_s: float
    theirs_s: float
    """Time of the reference, or the target time [s]."""
    ratio: float
    aim: float
    """The ratio that we want to stay below."""
    spread: tuple[float, float] | None = None
    """First and third quartile of the ratios; None if only one was measured."""


async def compare(what: str, ours: Timed, theirs: Timed, rounds: int, aim: float) -> Row:
    """Time two functions in turn, after one round to warm up; the row contains the medians.

    Args:
        what: Text of the row.
        ours: The function under test.
        theirs: The reference.
        rounds: How often both are timed.
        aim: Largest ratio that is not marked.
    """
    await ours()
    await theirs()
    return row_of(what, [(await ours(), await theirs()) for _ in range(rounds)], aim)


async def against_aim(what: str, timed: Timed, rounds: int, aim_s: float) -> Row:
    """Time one function, after one round to warm up, and compare it with a target time [s]."""
    await timed()
    return row_of(what, [(await timed(), aim_s) for _ in range(rounds)], 1.0)


def compare_busy(what: str, ours: Work, theirs: Work, aim: float, *, calls: int, rounds: int = 21) -> Row:
    """Compare the processor time of two functions in this process.

    Args:
        what: Text of the row.
        ours: Makes one call of the function under test.
        theirs: Makes one call of the reference function.
        aim: Largest ratio that is not marked.
        calls: Calls of each side in a round.
        rounds: Number of rounds.
    """
    busy_s(ours, calls)
    busy_s(theirs, calls)
    return row_of(what, [(busy_s(ours, calls), busy_s(theirs, calls)) for _ in range(rounds)], aim)


def busy_against_aim(what: str, ours: Work, aim_s: float, *, calls: int, rounds: int = 21) -> Row:
    """Compare the processor time of one function with a target time; the row's text gets the calls per second."""
    busy_s(ours, calls)
    row = row_of(what, [(busy_s(ours, calls), aim_s) for _ in range(rounds)], 1.0)
    return row._replace(what=f"{what} ({1 / row.ours_s:,.0f} a second and core)")


def busy_s(work: Work, calls: int) -> float:
    """Return the processor time of one call [s], averaged over several calls."""
    start = time.process_time()
    for _ in range(calls):
        work()
    return (time.process_time() - start) / calls


def row_of(what: str, pairs: Sequence[tuple[float, float]], aim: float) -> Row:
    """Make the table row from pairs of durations [s], one pair for each round."""
    ratios = [mine / other for mine, other in pairs]
    low, _, high = statistics.quantiles(ratios, n=4)
    return Row(
        what,
        statistics.median(mine for mine, _ in pairs),
        statistics.median(other for _, other in pairs),
        statistics.median(ratios),
        aim,
        (low, high),
    )
