"""Queries on an episode for the detectors: its readings, actions and simulated time. Knows no failure modes."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from evaluator.records.episode import Episode, Exchange, Outcome

ANSWER = "answer"
STEP = "step"

ACTIONS = frozenset(
    {
        *("apply_force", "apply_torque", "set_velocity", "move_object", "change_position"),
        *("create_objects", "delete_objects", "attach_objects"),
    }
)
"""Tools that change the laboratory; their result repeats the request, so it is not a reading."""

PUSHES = frozenset({"apply_force", "apply_torque", "set_velocity"})
"""The actions that set something in motion when time passes."""

MOTION_READINGS = frozenset(
    {
        *("get_velocity", "get_acceleration", "get_displacement", "get_momentum", "get_angular_momentum"),
        *("get_kinetic_energy", "get_rotational_energy", "compute_force", "detect_collision", "get_torque"),
    }
)
"""Tools that read motion or contact, which mean little before time has passed."""

_STILL = 1e-9
"""Largest absolute value that is 0 except for rounding."""
_NO_READINGS = ACTIONS | {ANSWER, STEP, "quat_to_rot_matrix"}
_ID_ARGUMENTS = ("object_id", "obj1_id", "obj2_id", "object1_id", "object2_id")


class Place(NamedTuple):
    """An exchange and its position in the episode."""

    turn: int
    position: int
    """Index of the exchange within the turn, from 0."""
    exchange: Exchange

    @property
    def tool(self) -> str:
        """Name of the tool."""
        return self.exchange.call.tool

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of the call."""
        return self.exchange.call.arguments


def exchanges(episode: Episode) -> Iterator[Place]:
    """All exchanges, in order."""
    for number, turn in enumerate(episode.turns):
        for index, exchange in enumerate(turn.exchanges):
            yield Place(number, index, exchange)


def succeeded(place: Place) -> bool:
    """Whether a call ran and returned no error."""
    return place.exchange.returned and not place.exchange.is_error


def is_reading(place: Place) -> bool:
    """Whether a call succeeded and its result says something about the laboratory that the arguments do not."""
    return succeeded(place) and place.tool not in _NO_READINGS


def shows_motion(place: Place) -> bool:
    """Whether a reading of motion or contact has a non-zero value."""
    return place.tool in MOTION_READINGS and any(abs(value) > _STILL for value in measured_numbers(place))


def measured_numbers(place: Place) -> Iterator[float]:
    """All numbers in a result, but for the clock and the count of time steps; true counts as 1."""
    content = place.exchange.content or {}
    return _numbers({name: value for name, value in content.items() if name not in {"sim_time", "time", "steps"}})


def _numbers(value: Any) -> Iterator[float]:
    """All numbers in a JSON value; true counts as 1."""
    if isinstance(value, dict):
        value = list(value.values())  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON
    if isinstance(value, list):
        for part in value:  # pyright: ignore[reportUnknownVariableType] - JSON
            yield from _numbers(part)
    elif isinstance(value, int | float):
        yield float(value)


def has_answered(episode: Episode) -> bool:
    """Whether the episode ended with an answer."""
    return episode.outcome is Outcome.ANSWERED and bool(episode.turns)


def read_before_answer(episode: Episode) -> list[Place]:
    """The readings that the agent had seen when it wrote its answer: those of earlier turns."""
    return [place for place in exchanges(episode) if place.turn < len(episode.turns) - 1 and is_reading(place)]


def step_duration(place: Place) -> float | None:
    """Duration of a successful `step` call [s]; None for any other call."""
    duration = place.arguments.get("duration")
    if place.tool != STEP or not succeeded(place) or isinstance(duration, bool):
        return None
    return float(duration) if isinstance(duration, int | float) else None


def objects_named(place: Place) -> list[str]:
    """The object ids in a call's arguments, as written."""
    return [str(place.arguments[name]) for name in _ID_ARGUMENTS if name in place.arguments]
