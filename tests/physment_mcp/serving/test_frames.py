"""Tests of frames (`--observations rgb`): off by default, valid images, and only visible bodies in them."""

import base64
import os
import struct
import subprocess
import sys
import xml.etree.ElementTree as ET
import zlib
from typing import Any

import mcp_types as types
import numpy as np
import pytest
from mcp import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

from physment_mcp.scene import load_scene, load_variants, scene_ids
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.serving.views import Frames, Painter
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from physment_mcp.visibility import bodies_of, visibility_of
from physment_mcp.world.pictures.showing import picture_model
from tests.builders.frames import open_painter
from tests.builders.laboratory import OpenLab, WritePack

pytestmark = pytest.mark.anyio
Pixels = np.ndarray


painter = pytest.fixture(scope="module")(open_painter)


def pixels_of(png: bytes) -> Pixels:
    """Pixels of a PNG file; checks every chunk."""
    assert png.startswith(b"\x89PNG\r\n\x1a\n")
    chunks: dict[bytes, bytes] = {}
    place = 8
    while place < len(png):
        (size,) = struct.unpack_from(">I", png, place)
        kind, content = png[place + 4 : place + 8], png[place + 8 : place + 8 + size]
        assert struct.unpack_from(">I", png, place + 8 + size) == (zlib.crc32(kind + content),)
        chunks[kind] = content
        place += 12 + size
    assert list(chunks) == [b"IHDR", b"IDAT", b"IEND"]
    width, height = struct.unpack_from(">II", chunks[b"IHDR"])
    lines = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, 1 + 3 * width)
    rows = np.zeros((height + 1, 3 * width), np.uint8)
    for number, line in enumerate(lines):
        rows[number + 1] = line[1:] + (rows[number] if line[0] == 2 else 0)
    return rows[1:].reshape(height, width, 3)


def frames_of(scene: int, seed: int, painter: Painter) -> tuple[Session, Frames]:
    session = Session(load_scene(scene, seed))
    return session, Frames(session, load_variants(scene), painter)


def images(result: types.CallToolResult) -> list[bytes]:
    assert isinstance(result.content[0], types.TextContent)
    shown = result.content[1:]
    assert all(isinstance(part, types.ImageContent) and part.mime_type == "image/png" for part in shown)
    return [base64.b64decode(part.data) for part in shown if isinstance(part, types.ImageContent)]


async def test_results_contain_only_text_by_default(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        for tool, arguments in (("step", {"duration": 0.1}), ("find_objects", {})):
            assert images(await lab.client.call_tool(tool, arguments)) == []


async def test_only_results_of_step_and_find_objects_carry_a_frame(
    painter: Painter, pack: dict[str, Any], xml: str, write_pack: WritePack
) -> None:
    folder = write_pack(pack, xml)
    slot = EpisodeSlot(
        Session(load_scene(7, 0, folder)), watch=lambda session: Frames(session, load_variants(7, folder), painter)
    )
    async with Client(build_server(slot)) as client:
        seen: list[Pixels] = []
        for tool, arguments in (("step", {"duration": 0.01}), ("find_objects", {}), ("step", {"duration": 0.3})):
            result = await client.call_tool(tool, arguments)
            assert result.structured_content is not None
            (png,) = images(result)
            seen.append(pixels_of(png))
        assert all(pixels.shape == (240, 320, 3) for pixels in seen)
        assert not np.array_equal(seen[0], seen[1])
        assert not np.array_equal(seen[1], seen[2])
        assert images(await client.call_tool("get_position", {"object_id": "object_1"})) == []
        refused = await client.call_tool("step", {"duration": -1})
        assert refused.is_error
        assert len(refused.content) == 1


@pytest.mark.parametrize(
    ("scene", "shows"),
    [(7, True), (13, True), (21, True), (25, True), (40, True), (71, True), (100, True), (47, True), (46, False)],
)
def test_the_first_frame_is_the_same_for_every_seed(scene: int, shows: bool, painter: Painter) -> None:
    first, *others = [frames_of(scene, seed, painter)[1].draw() for seed in (0, 3, 101)]
    assert (first is not None) is shows
    assert all(frame == first for frame in others)


def test_a_hidden_body_shows_once_it_is_found(painter: Painter) -> None:
    session, frames = frames_of(21, 0, painter)
    before = frames.draw()
    planted = {item.body for item in session.state.objects.values() if not item.known}
    assert planted
    variants = load_variants(21)
    assert not any(f'"{body}"' in given(session, *variants) for body in planted)
    session.reveal()
    assert all(f'"{body}"' in given(session, *variants) for body in planted)
    after = frames.draw()
    assert after is not None
    assert after != before


def given(session: Session, *variants: str) -> str:
    """Return the model that the rendering process receives."""
    return picture_model(bodies_of(session, visibility_of(session.scene, variants).now(session)))


@pytest.mark.parametrize(
    ("withheld", "moves"),
    [({}, True), ({"body_pos": False}, False), ({"geom_size": False, "geom_radius": False}, False)],
)
def test_a_body_moves_in_the_picture_only_if_it_may_be_read(
    withheld: dict[str, bool],
    moves: bool,
    painter: Painter,
    pack: dict[str, Any],
    xml: str,
    write_pack: WritePack,
) -> None:
    pack["object_permissions"]["object_1_permissions"].update(withheld)
    session = Session(load_scene(7, 0, write_pack(pack, xml)))
    frames = Frames(session, [session.scene.mjcf], painter)
    before = frames.draw()
    assert before is not None
    session.world.place("object_1", np.array([0.3, 0.2, 1.5]), {})
    assert (frames.draw() != before) is moves


@pytest.mark.parametrize("readable", [True, False])
def test_turning_shows_only_if_the_orientation_may_be_read(
    readable: bool, painter: Painter, pack: dict[str, Any], xml: str, write_pack: WritePack
) -> None:
    pack["object_permissions"]["object_2_permissions"]["body_quat"] = readable
    pack["object_permissions"]["object_8_permissions"]["body_quat"] = readable
    session = Session(load_scene(7, 0, write_pack(pack, xml.replace('gravity="0 0 -9.81"', 'gravity="0 0 0"'))))
    frames = Frames(session, [session.scene.mjcf], painter)
    before, model = frames.draw(), given(session)
    assert '"object_2"' in model
    # The geom of the lower link is not at the link's origin, so its position reveals the orientation of the link.
    assert ('"object_8"' in model) is readable
    session.world.push("object_2", torque=np.array([0.0, 5.0, 0.0]))
    session.world.step(100)
    assert not np.allclose(session.world.pose("object_2").quaternion, [1, 0, 0, 0], atol=0.02)
    assert (frames.draw() != before) is readable


def test_what_the_seed_changes_is_not_shown(pack: dict[str, Any], xml: str, write_pack: WritePack) -> None:
    session = Session(load_scene(7, 0, write_pack(pack, xml)))
    other = xml.replace('name="object_9" pos="6 0 1"', 'name="object_9" pos="6 0 1.01"')
    assert other != xml
    assert '"object_2"' in given(session, other)
    same, changed = (given(session, variant) for variant in (xml, other))
    assert changed.count("<geom") == same.count("<geom") - 1


def nudged(session: Session, shift: float) -> None:
    """Move every joint by a small amount without a call, to get another state at the same simulated time."""
    saved = session.world.save()
    state = saved.state.copy()
    state[1 : 1 + saved.model.nq] += shift * np.random.default_rng(0).uniform(-1, 1, saved.model.nq)
    session.world.restore(saved._replace(state=state))


def read(session: Session) -> list[Any]:
    """Return the time and the poses of known objects, as `get_position` and `describe` read them."""
    places = [session.world.pose(item.body) for item in session.known()]
    return [[session.world.time, place.position.tolist(), place.quaternion.tolist()] for place in places]


INSTRUMENTED = [scene for scene in scene_ids() if load_scene(scene).public.instruments is not None]


def test_scenes_with_a_resolution_are_among_those_tried() -> None:
    assert {86, 88, 90, 202, 205, 206} <= set(INSTRUMENTED)


@pytest.mark.parametrize("scene", INSTRUMENTED)
def test_states_that_read_the_same_give_the_same_picture(scene: int) -> None:
    session = Session(load_scene(scene, 3))
    session.reveal()
    if not session.world.save().model.nq:
        sphere = {"density": 100, "radius": 0.05, "rgba": [1, 0, 0, 1]}
        call(session, "create_objects", {"name": "probe", "pos": [0, 0, 9], **sphere})
    session.world.step(40)
    before = (read(session), given(session))
    true = session.world.save().state.copy()
    for shift in (1e-5, 1e-6, 1e-7):
        nudged(session, shift)
        if read(session) == before[0]:
            break
        session.world.restore(session.world.save()._replace(state=true))
    else:
        pytest.fail("no other state was found that reads the same")
    assert not np.array_equal(session.world.save().state, true)
    assert given(session) == before[1]


@pytest.mark.parametrize("scene", scene_ids())
def test_every_object_is_drawn_where_it_is_read_and_the_rest_stays_as_it_was(scene: int) -> None:
    session = Session(load_scene(scene, 3))
    session.reveal()
    before = pictured(session)
    session.world.step(40)
    after = pictured(session)
    assert after.keys() == before.keys()
    for item in session.known():
        if item.object_id not in after:
            continue
        place = session.world.pose(item.body)
        *position, w, x, y, z = after[item.object_id][0]
        assert position == pytest.approx(place.position, abs=1e-6)
        turn = place.quaternion if session.may_read(item, "orientation") else [1, 0, 0, 0]
        assert [w, x, y, z] == pytest.approx(turn, abs=1e-5)
    assert {name: shapes for name, (_, shapes) in after.items()} == {
        name: shapes for name, (_, shapes) in before.items()
    }


def pictured(session: Session) -> dict[str, tuple[list[float], list[str]]]:
    """Return body → its pose and its shapes in its own frame, as the rendering process receives them."""
    model = given(session)
    found: dict[str, tuple[list[float], list[str]]] = {}
    for body in ET.fromstring(model).iter("body") if model else ():
        pose = [float(number) for name in ("pos", "quat") for number in body.get(name, "").split()]
        found[body.get("name", "")] = (pose, [ET.tostring(geom, encoding="unicode") for geom in body.iter("geom")])
    return found


@pytest.mark.parametrize("scene", [88, 90])
def test_a_motion_below_the_resolution_does_not_show(scene: int, painter: Painter) -> None:
    session, frames = frames_of(scene, 3, painter)
    before, readings = frames.draw(), read(session)
    nudged(session, 1e-6)
    assert read(session) == readings
    assert frames.draw() == before is not None


def test_a_painter_that_dies_is_replaced(painter: Painter) -> None:
    _, frames = frames_of(7, 0, painter)
    before = frames.draw()
    painter._process.kill()
    painter._process.wait(300)
    assert frames.draw() == before


@pytest.mark.parametrize("command", [["--scene", "7"], ["serve", "--port", "0"]])
def test_without_a_renderer_it_does_not_start_and_says_what_to_install(command: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "physment_mcp", *command, "--observations", "rgb"],
        env={**os.environ, "MUJOCO_GL": "off"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "install libosmesa6" in done.stderr


async def test_frames_reach_a_client_over_stdio(painter: Painter) -> None:
    command = StdioServerParameters(
        command=sys.executable,
        args=["-m", "physment_mcp", "--scene", "7", "--observations", "rgb"],
        env={name: os.environ[name] for name in ("PATH", "MUJOCO_GL") if name in os.environ},
    )
    async with Client(stdio_client(command)) as client:
        (png,) = images(await client.call_tool("step", {"duration": 0.1}))
    assert pixels_of(png).std() > 0
