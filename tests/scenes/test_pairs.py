"""Tests of coupled bodies: steady states solve the equations of motion; readings after a catch are left out."""

import numpy as np
import pytest

from scenes.pairs import DRAGS, JOINTS, Pair
from scenes.protocol import call

KNOBS = {"m": 2.0, "n": 1.5, "b": 0.8, "c": 0.4, "r": 0.6, "p": 1.2, "w": 0.5}
SPEED = 3.0


def pair(held: int) -> Pair:
    return Pair(joints=tuple(JOINTS), open_body=1, held=held, pushed=2, sigma=(0.01, 0.02), net=4.0, bend=(0.3, 0.8))


def test_a_viscous_joint_and_linear_drags_have_the_steady_state_of_the_textbook() -> None:
    other, force = pair(0).steady("oil, linear", KNOBS, SPEED)
    # For the second body, p (n v - u) = r u. The force balances the drag c v of the first body and n p (n v - u).
    assert other == pytest.approx(1.2 * 1.5 * SPEED / (1.2 + 0.6))
    assert force == pytest.approx(2.0 * (0.4 * SPEED + 1.5 * 1.2 * (1.5 * SPEED - other)))


@pytest.mark.parametrize("held", [0, 1])
@pytest.mark.parametrize("drag", DRAGS)
@pytest.mark.parametrize("joint", JOINTS)
def test_at_a_steady_state_nothing_accelerates(joint: str, drag: str, held: int) -> None:
    told, structure = pair(held), f"{joint}, {drag}"
    other, force = told.steady(structure, KNOBS, SPEED)
    speeds = (SPEED, other) if held == 0 else (other, SPEED)
    pushes = np.array([force, 0.0] if held == 0 else [0.0, force])
    rates = told.rates(structure, KNOBS, 0.0, np.array([0.0, 0.0, *speeds]), pushes)
    assert rates == pytest.approx([*speeds, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("joint", JOINTS)
def test_a_joint_passes_on_no_momentum_of_its_own(joint: str) -> None:
    free = KNOBS | {"c": 0.0, "r": 0.0}
    _, _, first, second = pair(0).rates(f"{joint}, linear", free, 0.0, np.array([0.0, 0.0, 2.0, 0.5]), np.zeros(2))
    # The joint acts on the first body n times as strongly as on the second, whose mass is b times as large.
    assert first == pytest.approx(-KNOBS["n"] * KNOBS["b"] * second)
    assert second > 0


def test_a_course_ends_where_a_net_has_caught_a_body() -> None:
    exchanges = []
    for place in (0.5, 2.0, 4.1, 3.9):
        exchanges.append((call("step", duration=0.5), {"sim_time": 0.5}))
        for body, at in (("object_1", place), ("object_2", 0.1)):
            exchanges.append((call("get_position", object_id=body), {"position": [at, 0, 0]}))
            exchanges.append((call("get_velocity", object_id=body), {"velocity": [0, 0, 0]}))
    assert pair(0).course(exchanges).readings[:, 0].tolist() == [0.5, 2.0]
