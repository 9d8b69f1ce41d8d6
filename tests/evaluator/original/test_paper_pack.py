"""Tests of the example pack that the paper prints: its time step, and its answer key, a string of four numbers."""

import logging
import shutil
from pathlib import Path

import pytest
from pydantic import JsonValue

from evaluator.answers.grading import grade
from evaluator.answers.keys import KeyRing
from evaluator.certify.lint import lint
from evaluator.commands.program import main
from evaluator.records.episode import Verdict
from physment_mcp.commands.program import parser
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from scenes import find_pack

FOLDER = Path(__file__).parent / "paper_pack"
SCENE = 112


@pytest.mark.parametrize(
    ("answer", "graded"),
    [
        ("3.98, 79.58, 5.97, 179.05", 1.0),
        ([3.98, 79.58, 5.97, 179.05], 1.0),
        (["3.98", "79.58", "5.97", "179.05"], 1.0),
        ("[3.98, 79.58, 5.97, 179.05]", 1.0),
        ("3.98, 79.58, 5.97, 120", 0.75),
        ([3.98, 10, 5.97, 120], 0.5),
        ("179.05", 0.0),
        ("4.0, 79.6", 0.0),
        (".", 0.0),
    ],
)
def test_a_key_written_as_one_string_is_a_list_of_numbers(answer: JsonValue, graded: float) -> None:
    verdict = grade(answer, KeyRing(FOLDER).key(SCENE, 0))
    assert verdict.graded == graded
    assert verdict.strict is (Verdict.CORRECT if graded == 1 else Verdict.INCORRECT)


def test_its_time_step_is_told_by_lint_and_at_opening(caplog: pytest.LogCaptureFixture) -> None:
    assert any("time step is 0.002 s" in fault for fault in lint(find_pack(SCENE, FOLDER)))
    with caplog.at_level(logging.WARNING):
        session = Session(load_scene(SCENE, 0, FOLDER))
    assert session.world.timestep == 0.002
    assert "scene 112 runs with the time step of its model, 0.002 s; the suite has 0.005 s" in caplog.text


def test_another_time_step_can_be_forced_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        session = Session(load_scene(SCENE, 0, FOLDER, 0.005))
    assert session.world.timestep == 0.005
    assert call(session, "step", {"duration": 0.1}).model_dump()["steps"] == 20
    assert caplog.text == ""


def test_the_command_line_takes_a_time_step_for_one_episode_and_for_a_host() -> None:
    assert parser().parse_args(["--timestep", "0.005"]).timestep == 0.005
    assert parser().parse_args(["serve", "--timestep", "0.005"]).timestep == 0.005
    assert parser().parse_args(["serve"]).timestep is None


def test_a_run_says_the_time_step_and_a_model_that_cannot_be_read_in_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packs = Path(shutil.copytree(FOLDER, tmp_path / "packs"))
    options = ["--scenes-dir", str(packs), "--scenes", str(SCENE), "--agent", "blind", "--budgets", "5"]
    assert main([*options, "--out", str(tmp_path / "run")]) == 0
    assert "1 scene runs with the time step of the model, 0.002 s; the paper has 0.005 s" in capsys.readouterr().err
    (packs / f"Scene{SCENE}" / f"scene{SCENE}.xml").write_text("<mujoco><option", encoding="utf-8")
    assert main([*options, "--out", str(tmp_path / "other")]) == 2
    assert "no time step can be read" in capsys.readouterr().err


def test_its_experiment_gives_its_answer() -> None:
    session = Session(load_scene(SCENE, 0, FOLDER, 0.005))
    read: list[JsonValue] = []
    mass = call(session, "get_parameters", {"object_id": "object_1"}).model_dump()["mass"]
    for torque in (20, 10):
        call(session, "apply_torque", {"object_id": "object_1", "torque_vector": [0, 0, torque]})
        call(session, "step", {"duration": 2})
        about = {"object_id": "object_1", "mass": mass}
        energy = call(session, "get_rotational_energy", about).model_dump()["rotational_energy"]
        momentum = call(session, "get_angular_momentum", about).model_dump()["angular_momentum"]["z"]
        read += [2 * energy / momentum, energy]
    assert grade(read, KeyRing(FOLDER).key(SCENE, 0)).strict is Verdict.CORRECT
