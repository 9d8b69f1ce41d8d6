"""Tests of views: poses and motion, only visible bodies, and no effect on the dynamics."""

import json
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from physment_mcp.scene import load_scene, load_variants, scene_ids
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.serving.views import recorded, view_of
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from physment_mcp.visibility import Visibility, visibility_of
from tests.builders.bench import fingerprint
from tests.builders.laboratory import WritePack

G = 9.81


@pytest.fixture
def session(pack: dict[str, Any], xml: str, write_pack: WritePack) -> Session:
    return Session(load_scene(7, 0, write_pack(pack, xml)))


def visibility(session: Session, *variants: str) -> Visibility:
    return visibility_of(session.scene, variants)


def after(session: Session, tool: str, **arguments: Any) -> dict[str, Any]:
    """The view after a call."""
    with recorded(session, tool, arguments) as states:
        call(session, tool, arguments)
    return view_of(session, visibility(session), states)


def body(view: dict[str, Any], name: str) -> dict[str, Any]:
    (found,) = [body for body in view["drawing"]["bodies"] if body["id"] == name]
    return found


def test_a_drawing_holds_the_shapes_as_mujoco_has_them_in_the_frames_of_their_bodies(session: Session) -> None:
    view = view_of(session, visibility(session))
    assert view["time"] == 0
    (box,) = body(view, "object_2")["parts"]
    assert (box["shape"], box["size"], box["pos"], box["quat"]) == ("box", [0.1, 0.2, 0.3], [0, 0, 0], [1, 0, 0, 0])
    assert box["rgba"] == pytest.approx([0.5, 0.5, 0.5, 1])
    (link,) = body(view, "object_8")["parts"]
    assert link["pos"] == [0, 0, -0.5]
    assert view["poses"]["object_8"] == [5, 0, 2.5, 1, 0, 0, 0]
    (floor,) = body(view, "object_3")["parts"]
    assert floor["shape"] == "plane"
    assert [body(view, name)["movable"] for name in ("object_1", "object_3")] == [True, False]


def test_what_is_hidden_or_masked_is_neither_drawn_nor_placed_until_it_may_be(session: Session) -> None:
    view = view_of(session, visibility(session))
    names = {f"object_{number}" for number in (1, 2, 3, 4, 7, 8, 9)}
    assert {body["id"] for body in view["drawing"]["bodies"]} == set(view["poses"]) == names
    found = after(session, "find_objects")
    assert set(found["poses"]) == names | {"object_5"}
    assert body(found, "object_5")["parts"][0]["rgba"][3] == 1


def test_objects_have_the_names_of_the_prompt_and_those_found_or_created_later_have_none(session: Session) -> None:
    names = {item.object_id: item.name for item, _ in session.opening}
    assert all(f"| {object_id} | {name} |" in opening_prompt(session) for object_id, name in names.items())
    assert view_of(session, visibility(session))["drawing"]["names"] == names
    ball = {"pos": [7, 0, 3], "density": 1000.0, "radius": 0.1, "rgba": [1, 0, 0, 1]}
    call(session, "create_objects", {"name": "late", **ball})
    found = after(session, "find_objects")
    assert {"object_5", "late"} <= set(found["poses"])
    assert found["drawing"]["names"] == names
    assert "object_5" not in names


def test_a_ball_falls_in_its_motion_as_in_the_formula(session: Session) -> None:
    motion = after(session, "step", duration=0.4)["motion"]
    times = motion["times"]
    assert (times[0], times[-1], len(times)) == (0, 0.4, 81)
    for time, pose in zip(times, motion["poses"]["object_1"], strict=True):
        assert pose == pytest.approx([0, 0, 1 - G * time**2 / 2, 1, 0, 0, 0], abs=2e-6)
    # The fixed post, and the pendulum that hangs at rest.
    assert {"object_9", "object_7"}.isdisjoint(motion["poses"])


def test_a_long_motion_has_about_120_instants_and_ends_now(session: Session) -> None:
    call(session, "step", {"duration": 0.015})
    view = after(session, "step", duration=7.0)
    times = view["motion"]["times"]
    assert len(times) <= 122
    assert (times[0], times[-1]) == (0.015, 7.015)
    steps = {round((second - first) / 0.005) for first, second in pairwise(times[1:-1])}
    assert steps == {12}
    assert view["motion"]["poses"]["object_1"][-1] == view["poses"]["object_1"]


@pytest.mark.parametrize("scene", [7, 21, 202])
def test_being_looked_at_changes_no_bit_of_the_world(scene: int) -> None:
    calls: list[tuple[str, dict[str, Any]]] = [
        ("step", {"duration": 0.3}),
        ("find_objects", {}),
        ("step", {"duration": 1.1}),
        ("step", {"duration": 0.005}),
    ]
    looked_at, alone = Session(load_scene(scene)), Session(load_scene(scene))
    found = visibility(looked_at, *load_variants(scene))
    for tool, arguments in calls:
        with recorded(looked_at, tool, arguments) as states:
            told = call(looked_at, tool, arguments)
        view_of(looked_at, found, states)
        assert told == call(alone, tool, arguments)
        assert looked_at.world.save().state.tobytes() == alone.world.save().state.tobytes()
        assert looked_at.state == alone.state


def test_a_refused_step_is_undone_while_it_is_recorded(session: Session) -> None:
    call(session, "apply_force", {"object_id": 1, "force_vector": [1e6, 0, 0]})
    session.world.set_velocity("object_1", np.array([1e300, 0, 0]))
    before = fingerprint(session)
    with recorded(session, "step", {"duration": 1.0}), pytest.raises(Exception, match="unstable"):
        call(session, "step", {"duration": 1.0})
    assert fingerprint(session)[1:] == before[1:]


def test_poses_are_read_by_the_instruments(pack: dict[str, Any], xml: str, write_pack: WritePack) -> None:
    pack["instruments"] = {"position": 0.01, "noise": {"position": 0.02}}
    session = Session(load_scene(7, 0, write_pack(pack, xml)))
    view = after(session, "step", duration=0.2)
    (first, *_, last) = view["motion"]["poses"]["object_1"]
    assert last == view["poses"]["object_1"]
    assert last[:3] == call(session, "get_position", {"object_id": 1}).model_dump()["position"]
    assert first[:3] != [0, 0, 1]


def test_without_an_orientation_to_read_only_the_place_is_told(
    pack: dict[str, Any], xml: str, write_pack: WritePack
) -> None:
    pack["object_permissions"]["object_2_permissions"]["body_quat"] = False
    session = Session(load_scene(7, 0, write_pack(pack, xml.replace('gravity="0 0 -9.81"', 'gravity="0 0 0"'))))
    before = view_of(session, visibility(session))
    call(session, "apply_torque", {"object_id": 2, "torque_vector": [0, 5, 0]})
    view = after(session, "step", duration=0.5)
    assert view["poses"]["object_2"] == [1, 0, 1, 1, 0, 0, 0]
    assert body(view, "object_2") == body(before, "object_2")
    assert "object_2" not in view["motion"]["poses"]


def test_a_body_whose_frame_depends_on_the_seed_is_not_drawn(session: Session) -> None:
    # The geom looks the same; its body is elsewhere.
    moved = '<body name="object_9" pos="6 0 1"><geom type="box" size="0.1 0.1 0.1"/>'
    other = session.scene.mjcf.replace(
        moved, '<body name="object_9" pos="6 0 2"><geom type="box" size="0.1 0.1 0.1" pos="0 0 -1"/>'
    )
    assert other != session.scene.mjcf
    assert "object_9" in view_of(session, visibility(session))["poses"]
    view = view_of(session, visibility(session, other))
    assert "object_9" not in view["poses"]
    assert "object_9" not in json.dumps(view["drawing"]["bodies"])


def views_at_the_start(scene: int, *seeds: int) -> set[str]:
    """The views of a scene at some seeds, serialised as for a client."""
    sessions = [Session(load_scene(scene, seed)) for seed in seeds]
    found = visibility(sessions[0], *(session.scene.mjcf for session in sessions))
    views = {json.dumps(view_of(session, found)) for session in sessions}
    hidden = [item.object_id for item in sessions[0].state.objects.values() if not item.known]
    assert [name for name in hidden for view in views if f'"{name}"' in view] == []
    return views


@pytest.mark.parametrize("scene", scene_ids())
def test_before_anything_is_measured_two_seeds_give_the_same_bytes(scene: int) -> None:
    assert len(views_at_the_start(scene, 0, 7)) == 1


@pytest.mark.parametrize("scene", [13, 21, 70])
def test_before_anything_is_measured_a_seed_that_was_not_compared_gives_the_same_bytes(scene: int) -> None:
    sessions = [Session(load_scene(scene, seed)) for seed in (0, 101, 2_000_003)]
    views = {json.dumps(view_of(session, visibility(session, *load_variants(scene)))) for session in sessions}
    assert len(views) == 1
