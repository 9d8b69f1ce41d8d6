"""Small charts as geometry for the page's own SVG: points in, coordinates and ticks out. Knows no episodes.

The page draws them itself, so that they take its colours, light or dark, and need nothing installed; figures for print
come from matplotlib (`evaluator.report.figures`).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

LEFT, RIGHT, TOP, BOTTOM = 46.0, 8.0, 8.0, 22.0
"""Room around the plotted area, for tick labels [px]."""


class Point(NamedTuple):
    """A value to plot, and the ends of its interval where it has one."""

    x: float
    y: float
    low: float | None = None
    high: float | None = None


class Series(NamedTuple):
    """Values of one name; a new segment begins where the line must break."""

    name: str
    segments: Sequence[Sequence[Point]]


class Tick(NamedTuple):
    """A place on an axis [px] and what is written there."""

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
    """`points` of polylines."""
    marks: Sequence[Mark]


class Chart(NamedTuple):
    """All that an SVG of a chart needs [px]."""

    title: str
    width: float
    height: float
    x_ticks: Sequence[Tick]
    y_ticks: Sequence[Tick]
    lines: Sequence[Line]


def chart(
    title: str,
    series: Sequence[Series],
    *,
    size: tuple[float, float] = (300, 150),
    x_ticks: Sequence[float] | None = None,
    y_range: tuple[float, float] | None = None,
    dodge: float = 0.0,
    percent: bool = False,
) -> Chart:
    """Lay a chart out.

    Args:
        title: Its name.
        series: What to plot; at least one point in all.
        size: Width and height [px].
        x_ticks: Values to label on the x axis; round ones if nothing is said.
        y_range: Ends of the y axis; round ones around the values if nothing is said.
        dodge: How far apart series stand at the same x [px].
        percent: Whether y is a share, labelled in per cent.
    """
    points = [point for one in series for segment in one.segments for point in segment]
    ys = list(y_range or [point.y for point in points])
    y_labels = ticks(min(ys), max(ys))
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
        [Tick(up.at(y), f"{100 * y:.0f} %" if percent else f"{y:.4g}") for y in y_labels],
        [_line(one, across._replace(shift=shift), up) for one, shift in zip(series, shifts, strict=True)],
    )


class _Axis(NamedTuple):
    """Values from `low` to `high`, drawn from `start` to `end` [px]."""

    low: float
    high: float
    start: float
    end: float
    shift: float = 0.0

    def at(self, value: float) -> float:
        """Where a value is drawn [px]."""
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
    """Round numbers that span a range: multiples of 1, 2 or 5 times a power of ten."""
    low, high = _span(low, high)
    raw = (high - low) / (most - 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= raw * (1 - 1e-9))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [float(f"{index * step:.12g}") for index in range(first, last + 1)]


def _span(low: float, high: float) -> tuple[float, float]:
    """Ends that are apart, so that a single value has a place in the middle."""
    if high - low > 1e-9 * max(abs(low), abs(high), 1e-300):
        return low, high
    half = 0.5 * max(abs(low), 1e-3)
    return low - half, high + half
