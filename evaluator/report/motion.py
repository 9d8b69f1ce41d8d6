"""Charts of how objects moved in an episode: position, angle, velocity and energy against simulated time.

Only values that the agent read are plotted, at the times of its readings. Nothing is played again.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from evaluator.records.episode import Turn
from evaluator.report.charts import Chart, Point, Series, chart
from evaluator.scores.experiment_cost import is_number, lab_clock

_AXES = ("x", "y", "z")
_READINGS = {
    "get_position": (("position", "position"), ("angle", "angle")),
    "move_object": (("position", "position"),),
    "change_position": (("position", "new_position"),),
    "get_velocity": (("velocity", "velocity"), ("angular velocity", "angular_velocity")),
    "set_velocity": (("velocity", "velocity"),),
    "get_kinetic_energy": (("energy", "kinetic_energy"),),
    "get_potential_energy": (("energy", "potential_energy"),),
    "get_rotational_energy": (("energy", "rotational_energy"),),
}
"""Tool → quantities, each with the field of its result."""
_UNITS = {"position": "m", "angle": "rad", "velocity": "m/s", "angular velocity": "rad/s", "energy": "J"}
_MOST = 6
"""Most charts of an episode; the objects read most often are chosen."""


class _Reading(NamedTuple):
    quantity: str
    body: str
    component: str
    time: float
    value: float


def motion_charts(turns: Sequence[Turn]) -> list[Chart]:
    """One chart for each object and quantity that changed, for those read most often; sorted by object."""
    found: defaultdict[tuple[str, str], defaultdict[str, list[Point]]] = defaultdict(lambda: defaultdict(list))
    for reading in _readings(turns):
        found[reading.body, reading.quantity][reading.component].append(Point(reading.time, reading.value))
    moved = {
        key: series
        for key, series in found.items()
        if any(len({point.x for point in points}) > 1 and _changes(points) for points in series.values())
    }
    weight = {key: sum(map(len, series.values())) for key, series in moved.items()}
    order = sorted(moved, key=lambda key: (-weight[key], key))[:_MOST]
    order.sort(key=lambda key: (key[0], list(_UNITS).index(key[1])))
    return [_drawn(body, quantity, moved[body, quantity]) for body, quantity in order]


def _drawn(body: str, quantity: str, series: dict[str, list[Point]]) -> Chart:
    title = f"{body}: {quantity} [{_UNITS[quantity]}] against time [s]"
    return chart(title, [Series(name, list(_segments(points))) for name, points in sorted(series.items())])


def _segments(points: Sequence[Point]) -> Iterator[Sequence[Point]]:
    """Points in the order of reading, cut where the simulated time went back."""
    begin = 0
    for index in range(1, len(points)):
        if points[index].x < points[index - 1].x:
            yield points[begin:index]
            begin = index
    yield points[begin:]


def _changes(points: Sequence[Point]) -> bool:
    values = [point.y for point in points]
    return max(values) - min(values) > 1e-6 * max(1e-3, *map(abs, values))


def _readings(turns: Sequence[Turn]) -> Iterator[_Reading]:
    clock = 0.0
    for exchange in (exchange for turn in turns for exchange in turn.exchanges):
        content = exchange.content
        if not exchange.returned or exchange.is_error or content is None:
            continue
        clock = lab_clock(exchange, clock)
        body = exchange.call.arguments.get("object_id")
        if not isinstance(body, str | int):
            continue
        named = f"object_{body}" if str(body).isdecimal() else str(body)
        for quantity, field in _READINGS.get(exchange.call.tool, ()):
            for component, value in _components(field, content.get(field)):
                yield _Reading(quantity, named[:40], component, clock, value)


def _components(field: str, value: Any) -> Iterator[tuple[str, float]]:
    if is_number(value):
        yield field.removesuffix("_energy").replace("_", " "), float(value)
    elif isinstance(value, list):
        parts: list[Any] = value  # pyright: ignore[reportUnknownVariableType] - JSON
        if len(parts) == len(_AXES) and all(is_number(part) for part in parts):
            yield from zip(_AXES, map(float, parts), strict=True)
