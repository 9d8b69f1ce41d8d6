"""Tables of an episode's calls, one for each turn, and charts of the motion of objects.

Values are shown with nine significant digits, times with six. Charts show only values that the agent read, at the times
of its readings.
"""

import json
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, cast

from evaluator.episode.player import ANSWER
from evaluator.records.episode import Exchange, Turn
from evaluator.report.charts import Chart, Point, Series, chart
from evaluator.scores.dimensions import is_number, lab_clock
from evaluator.scores.evidence import COMPONENT_UNITS, FIELD_UNITS

_ARGUMENTS: Mapping[str, tuple[str, str]] = {
    "duration": ("", "s"),
    "force_vector": ("", "N"),
    "torque_vector": ("", "N·m"),
    "velocity_vector": ("", "m/s"),
    "pos": ("at", "m"),
    "density": ("density", "kg/m³"),
    "radius": ("radius", "m"),
    "mass": ("with mass", "kg"),
    "gravity": ("gravity", "m/s²"),
    **{name: (name, "m") for name in ("x", "y", "z", "dx", "dy", "dz")},
    "joint": ("by", ""),
    "answer": ("", ""),
    "q": ("", ""),
}
"""Argument → text before and after its value. Other arguments are shown with their names and without a unit."""
_UNSHOWN = {"name", "rgba"}
"""Arguments that are shown as object ids, or that have no physical meaning."""
_FOUND_UNITS = {"size": "m", "radius": "m"}
"""Units of fields that only found objects have."""
_ASIDE = {"sim_time", "time", "status", "object_id", "name", "steps", "lab_time_left", "calls_left", "results", "rgba"}
"""Fields that are shown in another column or above the table, or that have no physical meaning."""


class ShownValue(NamedTuple):
    """One value that a call returned."""

    name: str
    value: str
    unit: str
    """Empty for a pure number and for text."""


class CallRow(NamedTuple):
    """One call with its result, as a table row."""

    number: int
    """Number of the call in its turn, from 1."""
    exchange: Exchange
    time: str
    """Simulated time after the call [s]; empty if unchanged from the previous row."""
    asked: str
    """Object and arguments of the call."""
    quantities: Sequence[ShownValue]
    said: str
    """The non-numeric part of the result: a status or an error message."""


class TurnCalls(NamedTuple):
    """The calls of one turn."""

    rows: Sequence[CallRow]
    begin: float
    """Simulated time before the first call [s]."""
    end: float
    """Simulated time after the last call [s]."""
    left: str
    """Remaining lab time and calls after the last step; empty if no result contained them."""


def is_long(text: str, most: int = 90) -> bool:
    """Whether a text is longer than `most` characters and therefore collapsed."""
    return len(text) > most


def calls_of(turns: Sequence[Turn]) -> list[TurnCalls]:
    """The table rows of all turns of an episode, in order."""
    found: list[TurnCalls] = []
    clock, shown = 0.0, ""
    for turn in turns:
        begin, left = clock, ""
        rows: list[CallRow] = []
        for number, exchange in enumerate(turn.exchanges, start=1):
            clock = lab_clock(exchange, clock) if exchange.returned else clock
            time, left = f"{clock:.6g}", _left(exchange) or left
            same = time == shown and bool(rows)
            rows.append(CallRow(number, exchange, "" if same else time, _asked(exchange), *_returned(exchange)))
            shown = time
        found.append(TurnCalls(rows, begin, clock, left))
    return found


def _left(exchange: Exchange) -> str:
    content = exchange.content or {}
    time, calls = content.get("lab_time_left"), content.get("calls_left")
    parts = [f"{time:.6g} s of lab time"] if is_number(time) else []
    parts += [f"{calls} calls"] if is_number(calls) else []
    return " and ".join(parts)


def _ids(arguments: Mapping[str, Any]) -> Iterator[Any]:
    return (value for name, value in arguments.items() if name.endswith("_id"))


def _asked(exchange: Exchange) -> str:
    arguments = exchange.call.arguments
    ids = [f"object_{value}" if str(value).isdecimal() else str(value) for value in _ids(arguments)]
    named = [str(arguments["name"])] if "name" in arguments else []
    parts: list[str] = []
    for name, value in arguments.items():
        if value is None or name in _UNSHOWN or name.endswith("_id"):
            continue
        before, unit = _ARGUMENTS.get(name, (name.replace("_", " "), ""))
        parts.append(" ".join(filter(None, (before, _written(value, 7), unit))))
    return ", ".join([*ids, *named, *parts])


def _returned(exchange: Exchange) -> tuple[Sequence[ShownValue], str]:
    """The quantities in a result, and its status or error message."""
    if exchange.is_error or not exchange.returned or exchange.content is None:
        return (), exchange.text
    if exchange.call.tool == ANSWER:
        return (), "taken down"
    found = list(_quantities(exchange, exchange.content))
    if found:
        return found, ""
    if is_number(exchange.content.get("steps")):
        return (), f"{exchange.content['steps']} time steps"
    status = exchange.content.get("status")
    return (), status if isinstance(status, str) else "" if exchange.content.keys() <= _ASIDE else exchange.text


def _quantities(exchange: Exchange, content: Mapping[str, Any]) -> Iterator[ShownValue]:
    """The values in a result, without those that only repeat an argument."""
    if content.keys() >= {"x", "y", "z"}:
        name = exchange.call.tool.removeprefix("get_").removeprefix("compute_")
        vector = [content[axis] for axis in "xyz"]
        yield ShownValue(name.replace("_", " "), _written(vector), COMPONENT_UNITS.get(exchange.call.tool, ""))
    for name, value in content.items():
        asked = exchange.call.arguments
        echo = value in asked.values() if isinstance(value, list) else name in asked and value == asked[name]
        if name not in _ASIDE and name not in {"x", "y", "z"} and value is not None and not echo:
            yield from _read(name, value)


def _read(name: str, value: Any) -> Iterator[ShownValue]:
    """Yield the values in one field of a result. Only a field that lists found objects has several values."""
    if name == "revealed" and isinstance(value, list):
        yield from _found(cast(list[Any], value))
    else:
        yield ShownValue(name.replace("_", " "), _written(value), _unit(name))


def _found(objects: Sequence[Any]) -> Iterator[ShownValue]:
    """The values of the objects that a search found."""
    if not objects:
        yield ShownValue("found", "nothing", "")
    for one in objects:
        if not isinstance(one, dict):
            yield ShownValue("found", _written(one), "")
            continue
        fields = cast(dict[str, Any], one)
        parts = [
            " ".join(filter(None, (name.replace("_", " "), _written(value), _unit(name))))
            for name, value in fields.items()
            if value is not None and name not in {"object_id", "name"}
        ]
        named = " ".join(str(fields[name]) for name in ("object_id", "name") if fields.get(name) is not None)
        yield ShownValue(f"found {named}".strip(), ", ".join(parts), "")


def _unit(name: str) -> str:
    unit = FIELD_UNITS.get(name) or _FOUND_UNITS.get(name, "")
    return "" if unit == "1" else unit


def _written(value: Any, digits: int = 9) -> str:
    """Format a value: numbers with `digits` significant digits, vectors in parentheses."""
    if isinstance(value, float):
        return f"{value:.{digits}g}"
    if isinstance(value, dict) and value.keys() == {"x", "y", "z"}:
        return _written(list(cast(dict[str, Any], value).values()), digits)
    if isinstance(value, list):
        items = cast(list[Any], value)
        texts = [_written(item, digits) for item in items]
        numeric = bool(items) and all(is_number(item) or isinstance(item, list) for item in items)
        return f"({', '.join(texts)})" if numeric else ", ".join(texts) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


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
"""Tool → pairs of a charted quantity and the field of the tool's result that holds it."""
_UNITS = {"position": "m", "angle": "rad", "velocity": "m/s", "angular velocity": "rad/s", "energy": "J"}
_MOST = 6
"""Largest number of charts of an episode; the objects read most often are chosen."""


class _Reading(NamedTuple):
    quantity: str
    body: str
    component: str
    time: float
    value: float


def motion_charts(turns: Sequence[Turn]) -> list[Chart]:
    """Charts of the objects and quantities that changed and were read most often, sorted by object."""
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
    """Split a series of points, in order of reading, wherever the simulated time decreases."""
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
