"""Tests that images, the app, the player's page, films and plates all follow one visibility rule."""

import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
from mcp import Client

from evaluator.certify.pictures import at_start
from evaluator.certify.viewed_episode import viewed_episode
from evaluator.episode.toolbox import shows_views, view_now
from evaluator.films.filming import film_of
from physment_mcp.contract.names import VIEW_URI
from physment_mcp.scene import load_scene, load_variants
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.serving.views import Frames, Painter
from physment_mcp.session import Session
from physment_mcp.visibility import cached_visibility, markers_at_start, visibility_of
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.showing import ShownBody
from scenes import default_folder, find_pack, list_packs, read_pack
from tests.builders.app_client import app_client
from tests.builders.records import episode, episode_key

Shapes = list[tuple[str, Sequence[float]]]
"""Shape and size of every part that is drawn, sorted."""


class Caught(Painter):
    """Replaces the rendering process, and stores the models that it would render."""

    def __init__(self) -> None:
        self.models: list[str] = []

    def draw(self, mjcf: str, view: View) -> bytes | None:
        self.models.append(mjcf)
        return b""


def in_bodies(bodies: Sequence[ShownBody]) -> Shapes:
    return sorted((part.shape, [round(length, 6) for length in part.size]) for body in bodies for part in body.parts)


def in_view(drawing: dict[str, Any]) -> Shapes:
    parts = (part for body in drawing["bodies"] for part in body["parts"])
    return sorted((part["shape"], [round(length, 6) for length in part["size"]]) for part in parts)


def in_model(mjcf: str) -> Shapes:
    geoms = re.findall(r"<geom [^>]*>", mjcf)
    found = ((re.findall(r'type="(\w+)"', geom)[0], re.findall(r'size="([^"]+)"', geom)[0]) for geom in geoms)
    return sorted((shape, [round(float(length), 6) for length in size.split()]) for shape, size in found)


@pytest.mark.parametrize("scene", [7, 21, 27, 88, 109, 210])
async def test_agents_the_app_players_films_and_plates_are_shown_the_same(scene: int) -> None:
    session = Session(load_scene(scene))
    caught = Caught()
    Frames(session, load_variants(scene), caught).draw()
    slot = EpisodeSlot(Session(load_scene(scene)), find_visibility=cached_visibility(None))
    async with app_client(build_server(slot)) as client:
        (app,) = (await client.read_resource(VIEW_URI)).contents
    slot = EpisodeSlot(Session(load_scene(scene)), find_visibility=cached_visibility(None))
    async with Client(build_server(slot), extensions=[shows_views()]) as client:
        played = await view_now(client)
    film = await film_of(
        episode(key=episode_key(scene)),
        lambda key: viewed_episode(key.scene, key.seed, None, cached_visibility(None)),
        "0" * 64,
        revealed=False,
    )
    shown = in_bodies(at_start(find_pack(scene))[1])
    assert in_view(json.loads(app.text)["drawing"]) == shown
    assert played is not None
    assert in_view(played["drawing"]) == shown
    assert in_view(film.model_dump()["drawings"][0]) == shown
    assert [in_model(model) for model in caught.models] == ([shown] if shown else [])


@pytest.mark.parametrize("scene", [17, 27, 76, 88, 109, 205])
def test_what_is_drawn_and_marked_at_the_start_is_the_same_for_every_seed(scene: int) -> None:
    """Shapes are compared bit for bit, and so are positions, except where an instrument has noise."""

    def shown(seed: int) -> list[list[tuple[str, Sequence[object]]]]:
        _, *found = at_start(find_pack(scene), seed)
        return [[(body.name, body.parts) for body in bodies if not body.name.startswith("fixture")] for bodies in found]

    assert shown(0) == shown(1) == shown(2)


def test_no_hidden_body_of_the_suite_is_drawn_or_marked() -> None:
    for files in list_packs(default_folder()):
        pack = read_pack(files)
        hidden = {f"object_{one.object_id}" for key, one in pack.objects.items() if pack.permissions_of(key).hidden}
        if hidden:
            _, bodies, markers = at_start(files)
            assert hidden.isdisjoint(body.name for body in (*bodies, *markers)), files.scene_id


def test_a_part_that_depends_on_the_seed_is_neither_drawn_nor_marked(tmp_path: Path) -> None:
    shutil.copytree(default_folder() / "Scene8", tmp_path / "Scene8")
    file = tmp_path / "Scene8" / "scene8.json"
    (name,) = {re.findall(r'<geom name="(object_1\w*)"', (tmp_path / "Scene8" / "scene8.xml").read_text("utf-8"))[0]}
    _, bodies, _ = at_start(find_pack(8, tmp_path))
    assert "object_1" in [body.name for body in bodies]
    pack = json.loads(file.read_text("utf-8"))
    pack["knobs"]["red"] = {"canonical": 0.5, "uniform": [0.1, 0.9], "meaning": "colour"}
    pack["apply"][f"geom[{name}].rgba"] = ["red", 0, 0, 1]
    file.write_text(json.dumps(pack), "utf-8")
    _, bodies, markers = at_start(find_pack(8, tmp_path))
    assert "object_1" not in [body.name for body in (*bodies, *markers)]


def test_an_object_of_which_only_the_position_may_be_read_is_marked_at_the_start() -> None:
    session, bodies, markers = at_start(find_pack(27))
    assert "object_1" not in [body.name for body in bodies]
    (marker,) = markers
    position = session.world.pose("object_1").position
    assert marker.pose == pytest.approx([*position, 1, 0, 0, 0], abs=1e-6)
    other = markers_at_start(session, visibility_of(session.scene, load_variants(27)))
    assert other == markers
