"""Tests of wheels under loads: loading of a pan, stepwise turning of a wheel, and recovered resistances."""

from collections.abc import Generator
from typing import Any

import numpy as np
import pytest

from scenes.fitting import Array
from scenes.loads import hung, mass_of
from scenes.protocol import Call
from scenes.wheels import LoadedPan, left_spin, resisted_member

PAN = LoadedPan("object_2", 1.0)
DONE: dict[str, Any] = {"status": "done"}
LAW, EDGE, FAR = (2.0, 3.0), 6.73, 20.0


def _parts(spin: Array, edge: float) -> list[Array]:
    return [spin, np.maximum(spin - edge, 0.0)]


def test_a_pan_bears_one_ball_at_a_time() -> None:
    calls = [*PAN.load(0, 1.5), *PAN.load(1, 4.0)]
    assert [asked.tool for asked in calls[:4]] == ["create_objects", "attach_objects", "step", "get_velocity"]
    assert Call("delete_objects", {"object_id": "b0"}) in calls
    assert mass_of(calls[0]) == pytest.approx(1.5)
    assert [load["object_2"] for *_, load in hung([(asked, DONE) for asked in calls])][-1] == pytest.approx(4.0)


def test_a_wheel_is_turned_by_loads_that_follow_the_spins_before() -> None:
    ended = list[Any]()

    def followed() -> Generator[list[Call], list[Any], None]:
        ended.extend((yield from PAN.turned(3, 0.01, [Call("find_objects")], [(2.0, 5.0, 9.0)] * 7, enough=8.0)))

    legs = followed()
    calls: list[Call] | None = next(legs)
    assert calls
    assert calls[0].tool == "find_objects"
    while calls:
        kg = next(mass_of(asked) for asked in calls if asked.tool == "create_objects")
        readings = [{"angular_velocity": kg / 0.5} if asked.tool == "get_velocity" else DONE for asked in calls]
        calls = _sent(legs, readings)
    seen, rows = ended
    assert [spin for spin, _ in rows] == pytest.approx([0.0, 0.02, 1.6, 5.0, 9.0])
    assert [kg for _, kg in rows] == pytest.approx([0.0, 0.01, 0.8, 2.5, 4.5])
    assert len(seen) == 1 + 4 * 5


def _sent(legs: Generator[list[Call], list[Any], None], readings: list[Any]) -> list[Call] | None:
    """The next calls; None at the end."""
    try:
        return legs.send(readings)
    except StopIteration:
        return None


def test_a_resistance_is_fitted_and_says_how_sure_its_prediction_is() -> None:
    spin = np.array([1.5, 2.5, 4.5, 5.5, 6.5, 7.0, 7.6, 8.1, 8.6, 9.4])
    torque = np.array(LAW) @ np.array(_parts(spin, EDGE))

    def far(found: Array, edge: float) -> float:
        return float(np.dot(found, _parts(np.array(FAR), edge)))

    fit = resisted_member(lambda edge: _parts(spin, edge), spin, torque, far, (5.5, 8.0))
    asked = far(np.array(LAW), EDGE)
    assert (fit.readings, fit.constants) == (10, 3)
    assert fit.answer == pytest.approx(asked, rel=1e-3)
    assert fit.chi_square < 0.01
    assert np.std(np.array(fit.plausible(40))) < 0.05 * asked


class _Wheel:
    """A wheel whose spin is its torque."""

    spin = 0.0

    def push(self, _: str, torque: Array) -> None:
        self.spin = float(torque[2])

    def step(self, _: int) -> None:
        pass

    def whole_steps(self, seconds: float) -> int:
        return round(seconds / 0.005)

    def turn(self, _: str) -> "_Wheel":
        return self


def test_what_is_left_of_a_disturbance_is_that_of_the_last_torque() -> None:
    assert left_spin(_Wheel(), "a", "a", (4.4, 4.0), 4.0, 1.0) == 0.0
    assert left_spin(_Wheel(), "a", "a", (4.4,), 4.0, 1.0) == pytest.approx(0.1)
