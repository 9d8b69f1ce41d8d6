"""Tests of systematic errors: readings of positions contain them if the prompt says so; other scenes are unchanged."""

import json
import math
from typing import Any

import numpy as np
import pytest

import physment_mcp
from physment_mcp.errors import SceneError
from physment_mcp.scene import Scene
from physment_mcp.serving.prompt_blocks import laboratory_blocks
from physment_mcp.session import Session
from physment_mcp.world import World
from scenes import Instruments, Permissions, PublicObject
from tests.builders.bench import Bench, public_pack

ALL = Permissions(geom_type=True, geom_size=True, body_pos=True, body_quat=True, body_mass=True, angle=True, spin=True)
BIAS, DRIFT = [0.5, -0.25, 0.0], [0.02, 0.0, -0.01]
STILL = '<body name="object_1" pos="0.125 0 5"><freejoint/><geom size="0.1"/></body>'
WHEEL = """
<body name="object_1" pos="0 0 1"><joint name="axle" type="hinge" axis="0 0 1"/>
  <geom type="cylinder" size="0.1 0.02" mass="2" contype="0" conaffinity="0"/></body>"""
ADMITTED: dict[str, Any] = {"bias": {"position": 1.0}, "drift": {"position": 0.1}}


def mjcf(bodies: str, errors: Any) -> str:
    text = json.dumps(errors).replace('"', "&quot;")
    return (
        '<mujoco><option timestep="0.005" integrator="RK4" gravity="0 0 0"/>'
        f'<custom><text name="systematic_errors" data="{text}"/></custom><worldbody>{bodies}</worldbody></mujoco>'
    )


def bench(bodies: str, errors: Any, objects: int = 1, **instruments: Any) -> Bench:
    names = [f"object_{number}" for number in range(1, objects + 1)]
    public = public_pack(tuple(PublicObject(object_id=name, name="thing", permissions=ALL) for name in names))
    public = public.model_copy(update={"instruments": Instruments.model_validate(instruments)})
    return Bench(Session(Scene(public, mjcf(bodies, errors))))


async def test_the_mean_reading_of_a_still_body_is_its_position_plus_the_offset() -> None:
    lab = bench(STILL, {"position": {"bias": BIAS, "drift": [0.0] * 3}}, noise={"position": 0.02}, **ADMITTED)
    read: list[Any] = []
    for _ in range(400):
        read.append(await lab.position(1))
        await lab("step", duration=0.005)
    assert np.mean(read, axis=0) == pytest.approx(np.array([0.125, 0, 5]) + BIAS, abs=4 * 0.02 / math.sqrt(400))
    assert np.std(read, axis=0) == pytest.approx(0.02, rel=0.15)


async def test_the_offset_grows_with_the_clock_and_all_readings_of_a_position_have_it() -> None:
    lab = bench(STILL, {"position": {"bias": BIAS, "drift": DRIFT}}, position=1e-4, **ADMITTED)
    await lab("step", duration=3.0)
    wanted = np.array([0.125, 0, 5]) + BIAS + 3.0 * np.array(DRIFT)
    assert await lab.position(1) == pytest.approx(wanted, abs=1e-9)
    centre = (await lab("get_center_of_mass"))["center_of_mass"]
    assert [centre[axis] for axis in "xyz"] == pytest.approx(wanted, abs=1e-9)
    assert list((await lab("get_velocity", object_id=1))["velocity"]) == [0.0, 0.0, 0.0]
    # The position at the start was read with the offset of the start, so the displacement contains the drift alone.
    assert await lab.number("get_displacement", 1) == pytest.approx(3.0 * math.hypot(*DRIFT), abs=1e-3)


async def test_an_angle_and_an_orientation_have_the_same_error() -> None:
    errors = {"angle": {"bias": [0.0, 0.0, 0.4], "drift": [0.0, 0.0, 0.05]}}
    lab = bench(WHEEL, errors, bias={"angle": 0.5}, drift={"angle": 0.1})
    await lab("apply_torque", object_id=1, torque_vector=[0, 0, 0.01])
    await lab("step", duration=1.0)
    found = await lab("get_position", object_id=1)
    true = 0.5 * 0.01 / (0.5 * 2 * 0.1**2)
    assert found["angle"] == pytest.approx(true + 0.45, abs=1e-3)
    turn = found["orientation"]
    assert 2 * math.atan2(turn[3], turn[0]) == pytest.approx(found["angle"], abs=1e-6)


async def test_a_contact_is_read_with_the_error_of_one_position() -> None:
    def balls(errors: Any) -> Bench:
        other = STILL.replace("object_1", "object_2").replace("0.125", "0.32")
        return bench(STILL + other, errors, 2, **ADMITTED)

    touched = [
        await balls(errors)("detect_collision", obj1_id=1, obj2_id=2, elastic_response=False)
        for errors in ({}, {"position": {"bias": BIAS, "drift": DRIFT}})
    ]
    points = [np.array(one["contact_point"]) for one in touched]
    assert points[1] - points[0] == pytest.approx(np.array(BIAS), abs=1e-9)
    assert touched[0]["approach_speed"] == touched[1]["approach_speed"]


async def test_without_the_sentence_of_the_prompt_there_is_no_error() -> None:
    errors = {"position": {"bias": BIAS, "drift": DRIFT}}
    lab = bench(STILL, errors, position=1e-4, bias={"angle": 1.0})
    assert await lab.position(1) == pytest.approx([0.125, 0, 5], abs=1e-9)
    assert World(mjcf(STILL, errors)).pose("object_1").position == pytest.approx([0.125, 0, 5])


@pytest.mark.parametrize(
    "errors",
    [
        [1],
        {"position": {"bias": BIAS}},
        {"position": {"bias": [0.1], "drift": DRIFT}},
        {"position": {"bias": ["much", 0, 0], "drift": DRIFT}},
        {"velocity": {"bias": BIAS, "drift": DRIFT}},
    ],
)
def test_an_error_that_cannot_be_read_is_refused_in_a_sentence(errors: Any) -> None:
    with pytest.raises(SceneError, match="systematic errors") as refusal:
        bench(STILL, errors, **ADMITTED)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("instruments", "sentence"),
    [
        (
            ADMITTED,
            "Each coordinate of it is between -1 and 1 m when the clock shows 0, and changes at a constant rate between"
            " -0.1 and 0.1 m/s.",
        ),
        ({"bias": {"position": 0.5}}, "is between -0.5 and 0.5 m when the clock shows 0, and stays so."),
        ({"drift": {"angle": 0.02}}, "is 0 when the clock shows 0, and changes at a constant rate between -0.02 and"),
    ],
)
def test_the_prompt_admits_the_error(instruments: dict[str, Any], sentence: str) -> None:
    pack = public_pack(()).model_copy(update={"instruments": Instruments.model_validate(instruments)})
    assert sentence in "".join(laboratory_blocks(pack))


def test_instruments_without_errors_are_written_as_before() -> None:
    written = Instruments(position=0.001).model_dump(mode="json")
    assert written == {"position": 0.001, "velocity": 0.0, "angle": 0.0, "spin": 0.0, "noise": None}


def test_readings_of_other_scenes_are_bit_for_bit_as_before() -> None:
    """The expected readings contain noise. They were recorded before instruments had systematic errors."""
    episode = physment_mcp.open_episode(201, 0)
    episode.call("step", duration=0.45)
    assert episode.call("get_position", object_id="object_1")["position"] == [-0.005, -0.001, 0.049]
    assert episode.call("get_velocity", object_id="object_1")["velocity"] == [0.007, -0.009, -0.005]
