"""Tests of the engine that computes answer keys: full precision, no limits, and modified apparatus."""

import numpy as np
import pytest

from evaluator.answers.engine import Engine
from physment_mcp.errors import SceneError

CART = """
<mujoco><option timestep="0.005" gravity="0 0 0"/>
 <worldbody><body name="object_1"><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
  <joint name="rail" type="slide" axis="1 0 0" range="-1 1" limited="true" damping="0.5"/></body></worldbody>
</mujoco>"""


def coasted(engine: Engine, force: float = 3.0, duration: float = 10.0) -> float:
    engine.push("object_1", force=np.array([force, 0.0, 0.0]))
    engine.step(engine.whole_steps(duration))
    return float(engine.twist("object_1").linear[0])


def test_a_change_of_the_apparatus_acts_and_starts_anew() -> None:
    engine = Engine(CART)
    coasted(engine)
    changed = engine.changed({"body[object_1]/inertial.mass": 4.0, "joint[rail].limited": "false"})
    assert changed.time == 0
    assert changed.mass("object_1") == 4.0
    assert coasted(changed) == pytest.approx(3 / 0.5 * (1 - np.exp(-0.5 * 10 / 4)), rel=5e-3)
    assert engine.mass("object_1") == 2.0
    assert engine.time == 10


def test_what_is_left_out_no_longer_acts_and_the_time_step_is_kept() -> None:
    engine = Engine(CART, 0.0025).changed(without=["joint[rail]"])
    assert engine.timestep == 0.0025
    assert not engine.is_movable("object_1")


def test_a_change_that_names_no_element_or_does_not_compile_is_refused() -> None:
    with pytest.raises(ValueError, match="names 0 elements"):
        Engine(CART).changed({"joint[road].damping": 1})
    with pytest.raises(SceneError, match="does not compile"):
        Engine(CART).changed({"joint[rail].type": "wheel"})
