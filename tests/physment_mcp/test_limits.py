"""Tests of scene limits: a call beyond a limit is refused with the remaining amount, and changes nothing."""

import math
from typing import Any

import pytest

from physment_mcp.errors import BeyondLimit
from physment_mcp.scene import Scene
from physment_mcp.session import MAX_SIMULATED_S, Session
from physment_mcp.tools.calls import call
from scenes import LabLimits, Permissions, PublicObject
from tests.builders.bench import Bench, public_pack
from tests.builders.laboratory import OpenLab

BALL = {"pos": [0, 0, 8], "density": 1000 / (4 / 3 * math.pi), "rgba": [1, 1, 1, 1]}
"""Arguments of `create_ball`: with a radius of r metres, the ball has a mass of 1000 r³ kg."""


async def lab_with(open_lab: OpenLab, pack: dict[str, Any], limits: dict[str, Any]) -> Bench:
    async with open_lab(pack | {"limits": limits}) as lab:
        return Bench(lab.session)


@pytest.mark.parametrize(
    ("tool", "argument", "kind", "unit"),
    [("apply_force", "force_vector", "force", "N"), ("apply_torque", "torque_vector", "torque", "N·m")],
)
async def test_a_load_up_to_its_limit_acts_and_a_larger_one_is_refused(
    open_lab: OpenLab, pack: dict[str, Any], tool: str, argument: str, kind: str, unit: str
) -> None:
    lab = await lab_with(open_lab, pack, {kind: 5.0})
    await lab(tool, object_id=1, **{argument: [3, 0, 4]})
    refused = await lab.refused(tool, object_id=1, **{argument: [3, 0.1, 4]})
    assert f"at most 5 {unit} can be applied here" in refused
    other, its_argument = ("apply_torque", "torque_vector") if kind == "force" else ("apply_force", "force_vector")
    await lab(other, object_id=1, **{its_argument: [100, 0, 0]})


async def test_a_limit_of_zero_means_that_nothing_can_be_applied_but_clearing_is_allowed(
    open_lab: OpenLab, pack: dict[str, Any]
) -> None:
    lab = await lab_with(open_lab, pack, {"force": 0})
    assert await lab.refused("apply_force", object_id=1, force_vector=[0, 0, 1e-6]) == (
        "no force can be applied in this laboratory"
    )
    await lab("apply_force", object_id=1, force_vector=[0, 0, 0])


async def test_created_objects_share_a_stock_of_mass_and_deleting_gives_nothing_back(
    open_lab: OpenLab, pack: dict[str, Any]
) -> None:
    lab = await lab_with(open_lab, pack, {"created_mass": 2.5})
    await lab("create_objects", name="first", **BALL)
    await lab("delete_objects", object_id="first")
    await lab("create_objects", name="second", **BALL)
    refused = await lab.refused("create_objects", name="third", **BALL)
    assert "of the 2.5 kg that can be created here, 0.5 kg are left" in refused
    await lab("create_objects", name="small", **BALL | {"pos": [0, 3, 8]}, radius=0.5 ** (1 / 3) / 10)


async def test_laboratory_time_can_be_used_to_its_end_and_no_further(open_lab: OpenLab, pack: dict[str, Any]) -> None:
    lab = await lab_with(open_lab, pack, {"lab_time": 2.0})
    assert (await lab("step", duration=1.5))["lab_time_left"] == 0.5
    assert "0.505 s is too long: 0.5 s of laboratory time are left" in await lab.refused("step", duration=0.505)
    assert (await lab("step", duration=0.5))["lab_time_left"] == 0
    assert "0 s of laboratory time are left" in await lab.refused("step", duration=0.005)


async def test_calls_are_counted_with_the_refused_ones_and_the_answer_is_always_possible(
    open_lab: OpenLab, pack: dict[str, Any]
) -> None:
    lab = await lab_with(open_lab, pack, {"calls": 3})
    assert (await lab("step", duration=0.1))["calls_left"] == 2
    await lab.refused("get_position", object_id=99)
    await lab.refused("no_such_tool")
    sentence = "the 3 calls of this laboratory are used up; you can only answer now"
    assert await lab.refused("get_position", object_id=1) == sentence
    assert await lab.refused("get_position", object_id=1) == sentence
    await lab("answer", answer=1.0)
    assert lab.session.state.answered


async def test_a_refused_answer_counts_neither(open_lab: OpenLab, pack: dict[str, Any]) -> None:
    lab = await lab_with(open_lab, pack, {"calls": 1})
    await lab.refused("answer", answer=None)
    assert (await lab("step", duration=0.1))["calls_left"] == 0


async def test_a_pack_without_limits_has_the_hour_of_every_laboratory_and_no_others(
    open_lab: OpenLab, pack: dict[str, Any]
) -> None:
    async with open_lab(pack) as lab:
        told = await lab.call("step", duration=1)
        assert (told["lab_time_left"], told["calls_left"]) == (MAX_SIMULATED_S - 1, None)
        await lab.call("apply_force", object_id=1, force_vector=[1e5, 0, 0])
        assert "# Limits" not in lab.instructions
        assert "# Instruments" not in lab.instructions


async def test_the_prompt_states_every_limit_and_every_instrument(open_lab: OpenLab, pack: dict[str, Any]) -> None:
    pack["limits"] = {"force": 10, "torque": 0, "created_mass": 4, "lab_time": 200, "calls": 150}
    pack["instruments"] = {"position": 1e-4, "spin": 0.001, "noise": {"position": 0.002}}
    async with open_lab(pack) as lab:
        for line in (
            "- Forces: at most 10 N on an object.",
            "- Torques: none can be applied.",
            "- Created objects: at most 4 kg in all; what is deleted does not come back.",
            "- Laboratory time: 200 s.",
            "- Calls: 150; refused calls count, `answer` does not.",
            "- Positions, each coordinate: a resolution of 0.0001 m and a random error with a standard deviation of"
            " 0.002 m.",
            "- Spins: a resolution of 0.001 rad/s.",
        ):
            assert line in lab.instructions.splitlines()
        assert "Velocities" not in lab.instructions


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        ({"kind": "number", "unit": "m"}, "A number counts as right within 5 % of what this laboratory really gives"),
        ({"kind": "number", "unit": "m", "abs_tol": 0.02}, "within 5 % plus 0.02 m of"),
        ({"kind": "numbers", "unit": ["m", "s"], "labels": ["a", "b"], "rel_tol": 0.1}, "within 10 % of"),
        ({"kind": "number", "unit": "1", "rel_tol": 0, "abs_tol": 0.5}, "within 0.5 of"),
        (None, "A number counts as right within 5 % of"),
    ],
)
async def test_the_prompt_states_the_tolerance(
    open_lab: OpenLab, pack: dict[str, Any], spec: dict[str, Any] | None, told: str
) -> None:
    if spec is None:
        del pack["answer_spec"]
    else:
        pack["answer_spec"] = spec
    async with open_lab(pack) as lab:
        assert told in lab.instructions


def test_a_limit_is_not_exceeded_by_a_rounding_error() -> None:
    limits = LabLimits(force=0.3)
    session = Session(_scene(limits))
    call(session, "apply_force", {"object_id": "object_1", "force_vector": [0.1 + 0.2, 0, 0]})
    with pytest.raises(BeyondLimit):
        call(session, "apply_force", {"object_id": "object_1", "force_vector": [0.30001, 0, 0]})


def _scene(limits: LabLimits) -> Scene:
    ball = PublicObject(object_id="object_1", name="ball", permissions=Permissions(body_pos=True))
    body = '<body name="object_1"><freejoint/><geom size="0.1"/></body>'
    public = public_pack((ball,)).model_copy(update={"limits": limits})
    return Scene(public, f'<mujoco><option timestep="0.005"/><worldbody>{body}</worldbody></mujoco>')
