"""Two sides of a measurement, timed alternately in this process by the processor time that they take."""

import statistics
import time
from collections.abc import Callable
from typing import NamedTuple

Work = Callable[[], object]


class Row(NamedTuple):
    """A line of the table of `make bench`."""

    what: str
    ours_s: float
    theirs_s: float
    ratio: float
    aim: float


def compare(what: str, ours: Work, theirs: Work, aim: float, *, calls: int, rounds: int = 21) -> Row:
    """Medians of both sides' times for one call, and of the ratios of the rounds, after a round to warm up.

    Args:
        what: What is timed.
        ours: One call of ours.
        theirs: What it is compared with.
        aim: The ratio to reach.
        calls: Calls of each side in a round.
        rounds: Number of rounds.
    """
    timed(ours, calls)
    timed(theirs, calls)
    pairs = [(timed(ours, calls), timed(theirs, calls)) for _ in range(rounds)]
    ratio = statistics.median(mine / other for mine, other in pairs)
    return Row(
        what, statistics.median(mine for mine, _ in pairs), statistics.median(other for _, other in pairs), ratio, aim
    )


def against(what: str, ours: Work, limit_s: float, *, calls: int, rounds: int = 21) -> Row:
    """The median time of one call, as a share of a time [s] that it should not exceed; its name gets calls a second."""
    timed(ours, calls)
    taken = statistics.median(timed(ours, calls) for _ in range(rounds))
    return Row(f"{what} ({1 / taken:,.0f} a second and core)", taken, limit_s, taken / limit_s, 1.0)


def timed(work: Work, calls: int) -> float:
    """Processor time of one call [s], averaged over some."""
    start = time.process_time()
    for _ in range(calls):
        work()
    return (time.process_time() - start) / calls
