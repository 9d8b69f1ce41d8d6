"""Three attack strategies that do not model the scene, and the agent that plays them.

Each strategy is a protocol that sees only the opening prompt and stays within the limits it states. Certificate 7 of
a scene requires that these strategies are seldom right.
"""

import math
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from evaluator.agents.attackers.readings import (
    Control,
    Opening,
    Quantity,
    Survey,
    all_calls,
    all_controls,
    look_around,
    motion_calls,
    quantities,
    read_opening,
    unit,
    wait,
)
from evaluator.agents.reference import ProtocolPlayer
from evaluator.episode.player import Briefing
from evaluator.errors import UsageError
from evaluator.quantities.units import Unit, conversion
from evaluator.records.episode import EpisodeKey
from scenes.protocol import AnswerValue, Call, Protocol, Reading, answer

Attempt = Generator[list[Call], list[Reading], AnswerValue]
_SETTINGS, _DEGREE = 9, 2
"""Number of settings in a sweep of a control, and degree of the polynomial fitted to the readings."""
_FIRST_STEPS = (0.005, 0.045)
"""Durations of the two steps after which `_glance` reads; together ten time steps [s]."""
_TIME_SHARE = 0.8
"""Share of the laboratory time that all settings may use, if the question states no duration."""
_CALL_SHARE = 0.6
"""Share of the allowed calls that all settings may use."""


@dataclass(frozen=True, slots=True)
class _Row:
    """The readings at one setting of a control."""

    setting: float
    read: Mapping[str, Quantity]


def _glance(opening: Opening) -> Attempt:
    """Read every instrument at rest, then push with each control and read the first ten time steps.

    Answers with the last reading that has the asked unit and is not 0.
    """
    at_rest = all_calls(opening, opening.objects)[: opening.calls // 2]
    seen = quantities(at_rest, (yield at_rest))
    rows = [(_row(0.0, seen), unit("N"))]
    controls, parts = all_controls(opening, opening.objects), list[list[Call]]()
    for control in controls:
        read = motion_calls(opening, [control.object_id], [*opening.units, unit("m/s^2")])
        steps = [asked for duration in _FIRST_STEPS for asked in (*wait(duration), *read)]
        parts.append([control.set(control.limit), *steps, control.set(0.0)])
    readings = yield [asked for part in parts for asked in part]
    for control, part in zip(controls, parts, strict=True):
        pushed = quantities(part, readings[: len(part)])
        readings = readings[len(part) :]
        rows.append((_row(control.limit, pushed), control.unit))
        seen += pushed
    if opening.options:
        return _extreme(opening, seen)
    return _stated(opening, [_last(rows, wanted) for wanted in opening.units])


def _row(setting: float, seen: Sequence[Quantity]) -> _Row:
    """Return a row with the last nonzero value of each quantity."""
    return _Row(setting, {quantity.name: quantity for quantity in seen if quantity.value})


def _last(rows: Sequence[tuple[_Row, Unit]], wanted: Unit) -> float:
    """Return the last number in the wanted unit, or 1 if there is none.

    Args:
        rows: Each row of readings, with the unit of its setting.
        wanted: Unit of the number.
    """
    found = [
        values[0] for row, measure in rows for values in _fitting([row], measure, sum(_FIRST_STEPS), wanted).values()
    ]
    return found[-1] if found else 1.0


def _proportional(opening: Opening) -> Attempt:
    """Apply the limit of each control, and scale the largest response in proportion to the asked setting."""
    survey = yield from look_around(opening)
    best: list[tuple[float, float]] = [(0.0, 1.0)] * len(opening.units)
    seen: list[Quantity] = []
    for control in survey.controls:
        duration = _duration(opening, 2 * len(survey.controls))
        rows = yield from _sweep_control(opening, control, survey, 1, duration)
        seen += [quantity for row in rows for quantity in row.read.values()]
        for part, wanted in enumerate(opening.units):
            ratio = _asked_setting(opening, control, part) / control.limit
            for name, values in _fitting(rows, control.unit, duration, wanted).items():
                carried = values[-1] * (1.0 if "÷" in name else ratio)
                best[part] = max(best[part], (abs(values[-1]), carried))
    return _extreme(opening, seen) if opening.options else _stated(opening, [carried for _, carried in best])


def _sweep(opening: Opening) -> Attempt:
    """Fit a curve to readings at up to nine settings of each control, and evaluate it at the asked setting."""
    survey = yield from look_around(opening)
    best: list[tuple[float, float]] = [(-1.0, 1.0)] * len(opening.units)
    seen: list[Quantity] = []
    for control in survey.controls:
        per_setting = 2 + len(motion_calls(opening, survey.watched, opening.units))
        affordable = int(opening.calls * _CALL_SHARE) // (per_setting * len(survey.controls))
        settings = max(3, min(_SETTINGS, affordable))
        duration = _duration(opening, settings * len(survey.controls))
        rows = yield from _sweep_control(opening, control, survey, settings, duration)
        seen += [quantity for row in rows for quantity in row.read.values()]
        for part, wanted in enumerate(opening.units):
            best[part] = max(best[part], _continued(opening, rows, control, duration, part, wanted))
    return _extreme(opening, seen) if opening.options else _stated(opening, [value for _, value in best])


def _sweep_control(
    opening: Opening, control: Control, survey: Survey, settings: int, duration: float
) -> Generator[list[Call], list[Reading], list[_Row]]:
    """Return the readings at equally spaced settings of a control, up to its limit.

    The settings have the sign of the value that the question states for this control. Positions and angles are
    relative to the reading before the first setting; if the question states a duration, to the reading before each
    setting.
    """
    asked = opening.asked(control.unit)
    sign = -1.0 if asked and asked[-1] < 0 else 1.0
    read = motion_calls(opening, survey.watched, opening.units)
    values = [sign * control.limit * (number + 1) / settings for number in range(settings)]
    parts = [[*read], *([control.set(value), *wait(duration), *read] for value in values), [control.set(0.0)]]
    readings = yield [asked_call for part in parts for asked_call in part]
    rows: list[_Row] = []
    origin: dict[str, float] = {}
    for value, part in zip([0.0, *values], parts, strict=False):
        seen = {quantity.name: quantity for quantity in quantities(part, readings[: len(part)])}
        readings = readings[len(part) :]
        placed = {name: quantity for name, quantity in seen.items() if " get_position." in name}
        shifted = {
            name: Quantity(name, quantity.value - origin.get(name, quantity.value), quantity.unit)
            for name, quantity in placed.items()
        }
        rows.append(_Row(value, seen | shifted))
        if not origin or opening.asked(unit("s")):
            origin = {name: quantity.value for name, quantity in placed.items()}
    return [row for row in rows[1:] if row.read]


def _fitting(rows: Sequence[_Row], measure: Unit, duration: float, wanted: Unit) -> dict[str, list[float]]:
    """Return the series of readings in the wanted unit; if there are none, quotients of two series in this unit.

    Args:
        rows: Readings at each setting.
        measure: Unit of the settings.
        duration: Time for which each setting acted [s].
        wanted: Unit of the series.
    """
    if not rows:
        return {}
    names = [name for name in rows[0].read if all(name in row.read for row in rows)]
    series = {name: (rows[0].read[name].unit, [row.read[name].value for row in rows]) for name in names}
    direct = {
        name: [value * float(factor) for value in values]
        for name, (own, values) in series.items()
        if (factor := conversion(own, wanted)) is not None
    }
    if direct:
        return direct
    known = {"setting": (measure, [row.setting for row in rows]), "time": (unit("s"), [duration] * len(rows))}
    quotients: dict[str, list[float]] = {}
    for above, (unit_above, values_above) in (series | known).items():
        for below, (unit_below, values_below) in (series | known).items():
            factor = conversion(unit_above.times(unit_below.power(-1)), wanted)
            if above != below and factor is not None and all(values_below) and any(values_above):
                quotients[f"{above} ÷ {below}"] = [
                    high / low * float(factor) for high, low in zip(values_above, values_below, strict=True)
                ]
    return quotients


def _continued(
    opening: Opening, rows: Sequence[_Row], control: Control, duration: float, part: int, wanted: Unit
) -> tuple[float, float]:
    """Fit the series of readings with the largest range; returns this range and the fit at the question's value."""
    settings = [row.setting for row in rows]
    if conversion(control.unit, wanted) is not None:
        # The question asks for a setting: fit the setting as a function of the reading that the question states.
        read = {quantity.unit for row in rows for quantity in row.read.values()}
        stated = [(reading, opening.asked(reading)[-1]) for reading in read if opening.asked(reading)]
        curves = [
            (values, settings, value)
            for reading, value in stated
            for values in _fitting(rows, control.unit, duration, reading).values()
        ]
    else:
        at = _asked_setting(opening, control, part)
        curves = [(settings, values, at) for values in _fitting(rows, control.unit, duration, wanted).values()]
    ranked = [(float(np.ptp(ys)), xs, ys, at) for xs, ys, at in curves]
    if not ranked:
        return -1.0, 1.0
    spread, xs, ys, at = max(ranked, key=lambda entry: entry[0])
    return spread, _curve(xs, ys, at)


def _curve(xs: Sequence[float], ys: Sequence[float], at: float) -> float:
    """Evaluate the fitted curve at a point: a parabola, or a power law if its largest residual is smaller."""
    degree = min(_DEGREE, len(set(xs)) - 1)
    if degree < 1:
        return ys[-1]
    parabola = np.polyfit(xs, ys, degree)
    value, misfit = float(np.polyval(parabola, at)), float(np.abs(np.polyval(parabola, xs) - ys).max())
    # A power law has one sign; its two parameters come from a linear fit to the logarithms.
    if at and all(xs) and all(ys) and len({y > 0 for y in ys}) == len({*(x > 0 for x in xs), at > 0}) == 1:
        line = np.polyfit(np.log(np.abs(xs)), np.log(np.abs(ys)), 1)
        sign = math.copysign(1.0, ys[-1])
        if np.abs(sign * np.exp(np.polyval(line, np.log(np.abs(xs)))) - ys).max() < misfit:
            value = sign * math.exp(np.polyval(line, math.log(abs(at))))
    return value


def _asked_setting(opening: Opening, control: Control, part: int) -> float:
    """Return the value that the question states for a control, or the control's limit if it states none."""
    asked = opening.asked(control.unit)
    if not asked:
        return control.limit
    return asked[part] if len(asked) == len(opening.units) else asked[-1]


def _duration(opening: Opening, settings: int) -> float:
    """Return the time for which each setting acts [s]: what the question states, limited by the available time."""
    affordable = max(0.005, _TIME_SHARE * opening.lab_time / max(1, settings))
    return min([affordable, *filter(lambda asked: asked > 0, opening.asked(unit("s"))[-1:])])


def _extreme(opening: Opening, seen: Sequence[Quantity]) -> str:
    """Return the option whose object had the greatest speed; the first option if no option is an object."""

    def speed(option: str) -> float:
        speeds = (abs(read.value) for read in seen if read.name.startswith(f"{option} get_velocity."))
        return max(speeds, default=0.0)

    return max(opening.options, key=speed)


def _stated(opening: Opening, values: Sequence[float]) -> AnswerValue:
    finite = [value if math.isfinite(value) else 1.0 for value in values]
    return list(finite) if opening.is_list else finite[0]


def _within_limits(attempt: Callable[[Opening], Attempt]) -> Callable[[str], Protocol]:
    """Convert a strategy to a protocol that omits all calls beyond the scene's limits on calls and time."""

    def protocol(task: str) -> Protocol:
        opening = read_opening(task)
        playing, calls_left, time_left = attempt(opening), opening.calls, opening.lab_time
        try:
            batch = next(playing)
            while True:
                made: list[Call] = []
                for asked in batch:
                    duration = float(asked.arguments["duration"]) if asked.tool == "step" else 0.0
                    if len(made) == calls_left or duration > time_left:
                        break
                    time_left -= duration
                    made.append(asked)
                calls_left -= len(made)
                # The loop would treat a turn without calls as malformed, so an empty turn is not yielded.
                readings = (yield made) if made else []
                batch = playing.send([*readings, *({} for _ in batch[len(made) :])])
        except StopIteration as end:
            yield [answer(end.value)]

    protocol.__doc__ = attempt.__doc__
    return protocol


ATTACKERS: Mapping[str, Callable[[str], Protocol]] = {
    "sweep": _within_limits(_sweep),
    "glance": _within_limits(_glance),
    "proportional": _within_limits(_proportional),
}
"""Strategy name → function that takes the opening prompt and returns the protocol."""


@dataclass(frozen=True, slots=True)
class AttackerAgent:
    """Plays one of the generic attackers in every scene."""

    strategy: str
    """A name in `ATTACKERS`."""

    def __post_init__(self) -> None:
        if self.strategy not in ATTACKERS:
            raise UsageError(
                f"--agent attacker:{self.strategy}: there is no such attacker; they are {', '.join(ATTACKERS)}"
            )

    @property
    def name(self) -> str:
        """`attacker:` and the name of the strategy."""
        return f"attacker:{self.strategy}"

    def player(self, key: EpisodeKey, briefing: Briefing) -> ProtocolPlayer:
        """Return a player that sees only the opening prompt."""
        del key
        return ProtocolPlayer(ATTACKERS[self.strategy], briefing.prompt)
