"""The course of an episode as the detectors ask for it: readings, deeds, simulated time. Knows no failure modes."""

from collections.abc import Iterator
from typing import Any, NamedTuple

from evaluator.records import Episode, Exchange, Outcome

ANSWER = "answer"
STEP = "step"

DEEDS = frozenset(
    {
        *("apply_force", "apply_torque", "set_velocity", "move_object", "change_position"),
        *("create_objects", "delete_objects", "attach_objects"),
    }
)
"""Tools that change the laboratory; what they return is what was asked for, not a reading."""

PUSHES = frozenset({"apply_force", "apply_torque", "set_velocity"})
"""The deeds that set something in motion, once time passes."""

MOTION_READINGS = frozenset(
    {
        *("get_velocity", "get_acceleration", "get_displacement", "get_momentum", "get_angular_momentum"),
        *("get_kinetic_energy", "get_rotational_energy", "compute_force", "detect_collision", "get_torque"),
    }
)
"""Tools that tell of motion or contact, which say little before time passes."""

_STILL = 1e-9
"""Size of a reading that is 0 but for rounding."""
_NO_READINGS = DEEDS | {ANSWER, STEP, "quat_to_rot_matrix"}
_ID_ARGUMENTS = ("object_id", "obj1_id", "obj2_id", "object1_id", "object2_id")


class Place(NamedTuple):
    """An exchange and where it stands."""

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
        """What it was called with."""
        return self.exchange.call.arguments


def exchanges(episode: Episode) -> Iterator[Place]:
    """All exchanges, in order."""
    for number, turn in enumerate(episode.turns):
        for index, one in enumerate(turn.exchanges):
            yield Place(number, index, one)


def succeeded(place: Place) -> bool:
    """Tell whether a call ran and returned no error."""
    return place.exchange.returned and not place.exchange.is_error


def is_reading(place: Place) -> bool:
    """Tell whether a call told something of the laboratory that was not asked into it."""
    return succeeded(place) and place.tool not in _NO_READINGS


def shows_motion(place: Place) -> bool:
    """Tell whether a reading of motion is of something that moves or touches: not all of it is 0."""
    content = place.exchange.content or {}
    told = {name: value for name, value in content.items() if name not in {"sim_time", "time", "steps"}}
    return place.tool in MOTION_READINGS and any(abs(value) > _STILL for value in _numbers(told))


def _numbers(value: Any) -> Iterator[float]:
    """All numbers inside JSON; true counts as 1."""
    if isinstance(value, dict):
        value = list(value.values())  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON
    if isinstance(value, list):
        for one in value:  # pyright: ignore[reportUnknownVariableType] - JSON
            yield from _numbers(one)
    elif isinstance(value, int | float):
        yield float(value)


def has_answered(episode: Episode) -> bool:
    """Tell whether the episode ended with an answer."""
    return episode.outcome is Outcome.ANSWERED and bool(episode.turns)


def read_before_answer(episode: Episode) -> list[Place]:
    """The readings whose returns the agent had seen when it wrote its answer: those of earlier turns."""
    return [one for one in exchanges(episode) if one.turn < len(episode.turns) - 1 and is_reading(one)]


def step_duration(place: Place) -> float | None:
    """Simulated time of a call of `step` that ran [s]; None for any other call."""
    duration = place.arguments.get("duration")
    if place.tool != STEP or not succeeded(place) or isinstance(duration, bool):
        return None
    return float(duration) if isinstance(duration, int | float) else None


def objects_named(place: Place) -> list[str]:
    """The objects that a call names, as written."""
    return [str(place.arguments[name]) for name in _ID_ARGUMENTS if name in place.arguments]
