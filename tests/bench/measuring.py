"""Two things timed alternately in one run, and the row of the table that compares them."""

import statistics
from collections.abc import Awaitable, Callable
from typing import NamedTuple

Timed = Callable[[], Awaitable[float]]
"""Does the work once and returns its time [s]."""


class Row(NamedTuple):
    """One comparison."""

    what: str
    ours_s: float
    theirs_s: float
    """What ours is compared with; or the time that is aimed at."""
    ratio: float
    aim: float
    """The ratio that we want to stay below."""
    spread: tuple[float, float] | None = None
    """First and third quartile of the ratios; None if only one was measured."""


async def compare(what: str, ours: Timed, theirs: Timed, rounds: int, aim: float) -> Row:
    """Time both sides in turn, after one round to warm up; the row holds the medians.

    Args:
        what: Text of the row.
        ours: Our side.
        theirs: The other side.
        rounds: How often both are timed.
        aim: The ratio that we want to stay below.
    """
    await ours()
    await theirs()
    pairs = [(await ours(), await theirs()) for _ in range(rounds)]
    ratios = [our_time / their_time for our_time, their_time in pairs]
    low, _, high = statistics.quantiles(ratios, n=4)
    return Row(
        what,
        statistics.median(our_time for our_time, _ in pairs),
        statistics.median(their_time for _, their_time in pairs),
        statistics.median(ratios),
        aim,
        (low, high),
    )


async def against_aim(what: str, timed: Timed, rounds: int, aim_s: float) -> Row:
    """Time one thing, after one round to warm up, and compare it with the time [s] that is aimed at."""
    await timed()
    times = [await timed() for _ in range(rounds)]
    low, _, high = statistics.quantiles(times, n=4)
    median = statistics.median(times)
    return Row(what, median, aim_s, median / aim_s, 1.0, (low / aim_s, high / aim_s))
