"""The layout of small charts: computes coordinates and ticks from points.

The page draws these charts as SVG, so they follow its light or dark theme and need no library. Figures for print are
drawn with matplotlib (`evaluator.report.figures`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

LEFT, RIGHT, TOP, BOTTOM = 46.0, 8.0, 8.0, 22.0
"""Margins around the plotted area, for tick labels [px]."""


class Point(NamedTuple):
    """A point to plot, with the ends of its interval if it has one."""

    x: float
    y: float
    low: float | None = None
    high: float | None = None


class Series(NamedTuple):
    """A named series of values, cut into segments where its line must break."""

    name: str
    segments: Sequence[Sequence[Point]]


class Tick(NamedTuple):
    """A position on an axis [px] and its label."""

    at: float
    label: str


class Mark(NamedTuple):
    """A drawn value [px]."""

    x: float
    y: float
    low: float | None
    high: float | None


class Line(NamedTuple):
    """A drawn series."""

    name: str
    paths: Sequence[str]
    """The `points` attribute of each polyline."""
    marks: Sequence[Mark]


class Chart(NamedTuple):
    """The layout of a chart for its SVG template; all coordinates in px."""

    title: str
    width: float
    height: float
    x_ticks: Sequence[Tick]
    y_ticks: Sequence[Tick]
    lines: Sequence[Line]
    flag: Tick | None = None
    """A vertical line with a label."""
    calls: Sequence[int] = ()
    """If x is a number of calls: that number after each call of the episode, for the cursor of its film."""


def chart(
    title: str,
    series: Sequence[Series],
    *,
    size: tuple[float, float] = (300, 150),
    x_ticks: Sequence[float] | None = None,
    y_range: tuple[float, float] | None = None,
    dodge: float = 0.0,
    percent: bool = False,
    decades: bool = False,
    flag: tuple[float, str] | None = None,
    calls: Sequence[int] = (),
) -> Chart:
    """Lay out a chart.

    Args:
        title: Title of the chart.
        series: What to plot; together at least one point.
        size: Width and height [px].
        x_ticks: Values to label on the x axis; round values if None.
        y_range: Ends of the y axis; round values around the points if None.
        dodge: Horizontal distance between the marks of neighbouring series at the same x [px].
        percent: Whether y is a share, to be labelled in per cent.
        decades: Whether y is a decimal logarithm, to be labelled with powers of ten.
        flag: x and label of a vertical line.
        calls: See `Chart.calls`.
    """
    points = [point for line in series for segment in line.segments for point in segment]
    ys = list(y_range or [point.y for point in points])
    y_labels = _powers(min(ys), max(ys)) if decades else ticks(min(ys), max(ys))
    xs = [*(x_ticks or ()), *(point.x for point in points)]
    x_labels = list(x_ticks or ticks(min(xs), max(xs)))
    xs += x_labels
    (width, height), aside = size, dodge * len(series) / 2
    across = _Axis(*_span(min(xs), max(xs)), LEFT + aside, width - RIGHT - aside)
    up = _Axis(*_span(min(ys + y_labels), max(ys + y_labels)), height - BOTTOM, TOP)
    shifts = [dodge * (index - (len(series) - 1) / 2) for index in range(len(series))]
    return Chart(
        title,
        width,
        height,
        [Tick(across.at(x), f"{x:g}") for x in x_labels],
        [Tick(up.at(y), f"{100 * y:.0f} %" if percent else f"{10**y if decades else y:.4g}") for y in y_labels],
        [_line(line, across._replace(shift=shift), up) for line, shift in zip(series, shifts, strict=True)],
        flag and Tick(across.at(flag[0]), flag[1]),
        calls,
    )


class _Axis(NamedTuple):
    """A linear axis that maps values from `low` to `high` to coordinates from `start` to `end` [px]."""

    low: float
    high: float
    start: float
    end: float
    shift: float = 0.0

    def at(self, value: float) -> float:
        """The coordinate of a value [px]."""
        return round(self.start + self.shift + (value - self.low) / (self.high - self.low) * (self.end - self.start), 1)


def _line(series: Series, across: _Axis, up: _Axis) -> Line:
    segments = [
        [
            Mark(
                across.at(point.x),
                up.at(point.y),
                None if point.low is None else up.at(point.low),
                None if point.high is None else up.at(point.high),
            )
            for point in segment
        ]
        for segment in series.segments
    ]
    paths = [" ".join(f"{mark.x:g},{mark.y:g}" for mark in segment) for segment in segments if len(segment) > 1]
    return Line(series.name, paths, [mark for segment in segments for mark in segment])


def ticks(low: float, high: float, most: int = 5) -> list[float]:
    """Round numbers that cover a range: multiples of 1, 2 or 5 times a power of ten."""
    low, high = _span(low, high)
    raw = (high - low) / (most - 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw * (1 - 1e-9))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [float(f"{index * step:.12g}") for index in range(first, last + 1)]


def _powers(low: float, high: float) -> list[float]:
    """The whole numbers that cover a range of decimal logarithms; at least two."""
    first = math.floor(low)
    return [float(power) for power in range(first, max(math.ceil(high), first + 1) + 1)]


def _span(low: float, high: float) -> tuple[float, float]:
    """The ends of an axis; if all values are equal, an axis of small length around them."""
    if high - low > 1e-9 * max(abs(low), abs(high), 1e-300):
        return low, high
    half = 0.5 * max(abs(low), 1e-3)
    return low - half, high + half
