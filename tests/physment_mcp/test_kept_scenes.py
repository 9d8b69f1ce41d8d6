"""Tests of the cache of scenes: an episode is the same with a cached and a newly compiled scene."""

import random
import shutil
from pathlib import Path
from typing import Any

import pytest

from physment_mcp.errors import RefusedCall, SceneError
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from scenes import default_folder
from tests.builders.kept import forget_scenes
from tests.harness.fuzz.drawing import draw_call
from tests.harness.fuzz.invariants import model_bytes

SCENES = [7, 21, 60, 97, 100, 203]
"""Scenes of different size; some have hidden objects, joints, laws or limits."""


def told(session: Session, name: str, arguments: dict[str, Any]) -> str:
    """Return the result of a call as the agent receives it."""
    try:
        return call(session, name, arguments).model_dump_json()
    except RefusedCall as refusal:
        return str(refusal)


def contents(session: Session) -> tuple[Any, ...]:
    """Return the complete state of a session, for bitwise comparison."""
    world = session.world.save()
    starts = [item.start.tobytes() for item in session.state.objects.values()]
    about = (session.scene.mjcf, session.scene.public.model_dump_json(), opening_prompt(session))
    held = (world.state.tobytes(), model_bytes(world.model), world.spec.to_xml(), world.disturbed, world.revealed)
    return (*about, *held, starts, repr(session.state), repr(session.opening))


@pytest.mark.parametrize("scene", SCENES)
def test_no_call_on_an_episode_reaches_another_of_the_same_scene_and_seed(scene: int) -> None:
    source, moods = random.Random(scene), dict[str, float]()
    first, second = Session(load_scene(scene, 3)), Session(load_scene(scene, 3))
    made = [draw_call(first, (), moods, source)]
    for _ in range(60):
        told(first, made[-1].tool, dict(made[-1].arguments))
        made.append(draw_call(first, (), moods, source))
    edits = [("find_objects", {}), ("create_objects", {"name": "q", "pos": [8, 8, 8], "density": 9, "rgba": [1] * 4})]
    edits += [("delete_objects", {"object_id": item.object_id}) for item in first.known()]
    for name, arguments in edits:
        told(first, name, arguments)
    third = Session(load_scene(scene, 3))
    forget_scenes()
    fresh = Session(load_scene(scene, 3))
    assert contents(second) == contents(third) == contents(fresh)
    for drawn in made:
        answers = {told(session, drawn.tool, dict(drawn.arguments)) for session in (second, third, fresh)}
        assert len(answers) == 1
    assert second.world.save().state.tobytes() == fresh.world.save().state.tobytes()


def test_a_pack_that_is_changed_on_disk_is_read_again(tmp_path: Path) -> None:
    shutil.copytree(default_folder() / "Scene7", tmp_path / "Scene7")
    before = load_scene(7, 3, tmp_path)
    assert load_scene(7, 3, tmp_path) is before
    file = tmp_path / "Scene7" / "scene7.json"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("Speed of a dropped ball", "Speed of a falling ball"), encoding="utf-8")
    assert load_scene(7, 3, tmp_path).public.name == "Speed of a falling ball"
    file.write_text(text, encoding="utf-8")
    assert load_scene(7, 3, tmp_path).public.name == "Speed of a dropped ball"
    file.unlink()
    with pytest.raises(SceneError, match="no such file"):
        load_scene(7, 3, tmp_path)


def test_a_kept_scene_whose_files_lead_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "packs", tmp_path / "elsewhere.xml"
    shutil.copytree(default_folder() / "Scene7", folder / "Scene7")
    load_scene(7, 0, folder)
    (folder / "Scene7" / "scene7.xml").rename(elsewhere)
    (folder / "Scene7" / "scene7.xml").symlink_to(elsewhere)
    with pytest.raises(SceneError, match="leads out"):
        load_scene(7, 0, folder)


def test_a_scene_with_another_time_step_is_another_scene() -> None:
    usual, finer = load_scene(7, 0), load_scene(7, 0, timestep=0.001)
    assert (Session(usual).world.timestep, Session(finer).world.timestep) == (0.005, 0.001)
    assert Session(load_scene(7, 0)).world.timestep == 0.005
