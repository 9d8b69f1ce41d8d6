"""Tests that the installed version of MuJoCo has the properties that `world/` needs."""

import mujoco
import pytest

from physment_mcp.world.engines import delete, passive_forces_act

ARM = """
<mujoco>
  <option>{flags}</option>
  <worldbody>
    <body name="arm"><joint name="elbow"/><geom size="1"/>
      <body name="hand"><joint name="wrist"/><geom size="1"/><site name="palm"/></body>
    </body>
    <body name="ball"><freejoint name="free"/><geom size="1"/><site name="top"/></body>
  </worldbody>
  <equality>
    <connect name="held" site1="palm" site2="top"/>
    <joint name="stiff" joint1="elbow"/>
  </equality>
  <contact><exclude body1="hand" body2="ball"/></contact>
  <keyframe><key name="start" qpos="1 1 0 0 0 1 0 0 0"/></keyframe>
</mujoco>
"""


def arm(flags: str = "") -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(ARM.format(flags=f"<flag {flags}/>" if flags else ""))
    spec.compile()
    return spec


def test_a_deleted_keyframe_is_gone_and_the_rest_stays() -> None:
    spec = arm()
    delete(spec, spec.keys[0])
    model = spec.compile()
    assert (model.nkey, model.nbody, model.neq, model.nexclude) == (0, 4, 2, 1)


def test_with_a_body_goes_all_that_is_in_it_or_refers_to_it() -> None:
    spec = arm()
    delete(spec, spec.keys[0])
    delete(spec, spec.body("hand"))
    model = spec.compile()
    assert [model.body(index).name for index in range(1, model.nbody)] == ["arm", "ball"]
    assert [model.joint(index).name for index in range(model.njnt)] == ["elbow", "free"]
    assert [model.equality(index).name for index in range(model.neq)] == ["stiff"]
    assert (model.nsite, model.nexclude) == (1, 0)


def no_passive_forces() -> str:
    """The flags that switch off all passive forces: one in older versions, two in newer ones."""
    older = "mjDSBL_PASSIVE" in mujoco.mjtDisableBit.__members__
    return 'passive="disable"' if older else 'spring="disable" damper="disable"'


@pytest.mark.parametrize("flags", ["", 'gravity="disable"', 'contact="disable"'])
def test_passive_forces_act_unless_they_are_switched_off(flags: str) -> None:
    assert passive_forces_act(arm(flags).compile())
    assert not passive_forces_act(arm(f"{flags} {no_passive_forces()}").compile())


def test_the_engine_agrees_about_passive_forces() -> None:
    """Gravity compensation is a passive force: while passive forces act, nothing accelerates."""
    for flags, falls in (("", False), (no_passive_forces(), True)):
        spec = arm(flags)
        spec.body("ball").gravcomp = 1
        model = spec.compile()
        data = mujoco.MjData(model)
        model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EQUALITY) | int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        mujoco.mj_forward(model, data)
        fallen = abs(data.qacc[model.joint("free").dofadr[0] + 2]) > 1
        assert (fallen, passive_forces_act(model)) == (falls, not falls)
