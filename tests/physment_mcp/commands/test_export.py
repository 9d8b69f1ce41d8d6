"""Tests of exported packs: they suffice for a laboratory, and reveal no answer."""

import json
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
import pytest

from evaluator.agents.reference import ReferenceAgent
from evaluator.episode.hosts import LocalHost
from evaluator.episode.loop import play_episode
from evaluator.records.episode import Outcome
from physment_mcp.commands.program import main
from physment_mcp.scene import Scene, load_scene
from scenes import CANARY, Pack, find_pack, list_packs, read_pack
from tests.builders.laboratory import WritePack
from tests.builders.records import VERSIONS, episode_key

SECRETS = {
    "metadata.description": "canary-description",
    "answer": 76.5432123,
    "expected_behavior": "canary-behaviour",
    "reasoning": "canary-reasoning",
    "category": "easy-multi-hidden",
    "concepts": ["canary-concept"],
    "requires": ["canary_requires"],
    "knobs": {"canary_knob": {"canonical": 0.1, "uniform": [0.0987654, 0.2], "meaning": "canary-meaning"}},
    "derive": {"canary_derived": "canary_knob * 2"},
    "accept_draw": ["canary_knob > 0"],
    "apply": {"geom[canary_geom].size": ["canary_knob"]},
    "laws": [{"on": "object_1", "force": ["-vx", 0, 0], "present": "canary_knob > 1"}],
    "catches": [{"words": ["canary-catch"], "holds": {"canary_knob": [0, 1]}}],
    "family": {"canary-kind": "canary-law"},
    "version": "canary-version",
    "canary": CANARY,
    "an_author_note": "canary-note",
}


def public_fields(scene: Scene) -> Scene:
    return replace(scene, mjcf=ET.canonicalize(scene.mjcf, strip_text=True))  # which leaves comments out


def everything_in(folder: Path) -> str:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return "\n".join(f"{path.relative_to(folder)}\n{path.read_text(encoding='utf-8')}" for path in files)


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole suite, exported for two seeds."""
    folder = tmp_path_factory.mktemp("export") / "packs"
    assert main(["export", str(folder), "--seeds", "0,3"]) == 0
    return folder


def test_an_exported_suite_is_hosted_like_the_whole_one(exported: Path) -> None:
    assert [files.scene_id for files in list_packs(exported)] == [files.scene_id for files in list_packs()]
    for files in list_packs():
        for seed in (0, 3):
            hosted = public_fields(load_scene(files.scene_id, seed, exported))
            assert hosted == public_fields(load_scene(files.scene_id, seed))


def test_an_older_export_that_writes_soft_objects_as_numbers_is_read_the_same(exported: Path, tmp_path: Path) -> None:
    older = shutil.copytree(exported / "Scene18", tmp_path / "packs" / "Scene18") / "scene18.public.json"
    written = json.loads(older.read_text(encoding="utf-8"))
    assert written["soft_objects"] == ["object_1"]
    older.write_text(json.dumps(written | {"soft_objects": ["1"]}), encoding="utf-8")
    assert load_scene(18, 3, tmp_path / "packs") == load_scene(18, 3, exported)


def test_an_exported_suite_says_nothing_private(exported: Path) -> None:
    keys = {
        "scene_id", "name", "task", "problem_type", "objects", "answer_form", "disabled_tools", "soft_objects",
        "limits", "instruments", "steps", "schematic", "law_answer",
    }  # fmt: skip
    texts = everything_in(exported)
    assert CANARY not in texts
    assert "<!--" not in texts
    for files in list_packs():
        pack = read_pack(files)
        folder = exported / f"Scene{files.scene_id}"
        names = {path.name for path in folder.iterdir()}
        assert names == {f"scene{files.scene_id}.{rest}" for rest in ("public.json", "seed0.xml", "seed3.xml")}
        public = (folder / f"scene{files.scene_id}.public.json").read_text(encoding="utf-8")
        assert json.loads(public).keys() == keys
        told = " ".join(everything_in(folder).split())
        reasons = [pack.reasoning, pack.expected_behavior, pack.metadata.description, *pack.disabled_tools.values()]
        meanings = [knob.meaning for knob in pack.knobs.values()]
        assert pack.answer_spec is not None
        accepted = [
            *pack.answer_spec.accept,
            *(step.value for step in pack.steps.values() if isinstance(step.value, str)),
        ]
        asked = " ".join([pack.metadata.task, *pack.answer_spec.labels])
        for secret in (*reasons, *meanings, *accepted, *pack.derive):
            assert len(secret) < 12 or secret in asked or " ".join(secret.split()) not in told
        assert "canonical" not in told


def test_no_private_field_of_a_pack_is_exported(
    write_pack: WritePack, pack: dict[str, Any], xml: str, tmp_path: Path
) -> None:
    """Each private field, and one field that the format does not define, gets a text that must not be exported."""
    public = {
        "objects", "object_permissions", "number_of_objects", "answer_spec", "disabled_tools", "soft_objects", "format",
        "limits", "instruments", "steps", "schematic",
    }  # fmt: skip
    assert {key.split(".")[0] for key in SECRETS} | public == Pack.model_fields.keys() | {"an_author_note"}
    for key, value in SECRETS.items():
        place, _, inner = key.partition(".")
        if inner:
            pack[place][inner] = value
        else:
            pack[place] = value
    pack["answer_spec"] |= {"accept": ["canary-accept"]}
    pack["steps"] = {"public_name": {"meaning": "public meaning", "unit": "kg", "value": "canary_knob * 3"}}
    pack["disabled_tools"] = {"get_torque": "canary-reason"}
    pack["object_permissions"]["object_1_permissions"]["canary_permission"] = True
    xml = xml.replace(
        '<geom type="sphere" size="0.1" density="1000"/>', '<geom name="canary_geom" type="sphere" size="0.1"/>', 1
    )
    xml = xml.replace("<worldbody>", "<!-- canary-comment --><worldbody>")
    folder = write_pack(pack, xml)
    (folder / "Scene7" / "solution.py").write_text("# canary-solution", encoding="utf-8")
    (folder / "Scene7" / "notes.txt").write_text("canary-file", encoding="utf-8")
    target = tmp_path / "out"
    assert main(["export", str(target), "--scenes-dir", str(folder), "--seeds", "0-2"]) == 0
    told = everything_in(target)
    told = told.replace('name="canary_geom"', "")  # the world needs the names of its parts
    for secret in ("canary", "76.5432123", "0.0987654", "easy-multi-hidden", "kind of thing"):
        assert secret not in told
    assert public_fields(load_scene(7, 2, target)) == public_fields(load_scene(7, 2, folder))


async def test_the_reference_protocol_solves_an_exported_scene_like_the_whole_one(exported: Path) -> None:
    key = episode_key(seed=3, agent="reference")
    played = []
    with anyio.fail_after(120):
        for folder in (None, exported):
            async with LocalHost(folder) as host, host.open(7, 3) as client:
                agent = ReferenceAgent()
                played.append(await play_episode(agent, client, key, VERSIONS))
    one, other = played
    assert one.outcome is Outcome.ANSWERED
    assert (one.prompt, one.answer) == (other.prompt, other.answer)
    assert [[call.content for call in turn.exchanges] for turn in one.turns] == [
        [call.content for call in turn.exchanges] for turn in other.turns
    ]


def test_a_seed_that_was_not_exported_is_refused_in_one_sentence(
    exported: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--scene", "7", "--seed", "4", "--scenes-dir", str(exported)]) == 2
    said = capsys.readouterr().err
    assert "seed 4 was not exported; there are the seeds 0, 3" in said
    assert said.count("\n") == 1


def test_the_evaluator_refuses_exported_packs(exported: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "evaluator", "--scenes-dir", str(exported), "--scenes", "7", "--server", "stdio"],
        capture_output=True, text=True, check=False, timeout=300, cwd=exported.parent,
    )  # fmt: skip
    assert done.returncode == 2
    assert "exported without its private half" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--scenes", "7,9999"], "no scene 9999"),
        (["--scenes-dir", "/no/such/folder"], "no such folder"),
        (["--scenes-dir", "again"], "exported without its private half"),
        (["full"], "full: is not empty"),
        (["file"], "file: is not a folder"),
    ],
)
def test_an_impossible_export_is_refused_in_one_sentence(
    exported: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thing").touch()
    (tmp_path / "file").touch()
    words = [str(exported) if word == "again" else word for word in options]
    target = tmp_path / (words.pop(0) if words[0] in {"full", "file"} else "new")
    assert main(["export", str(target), *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert said in err
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("wrong", [["--scenes", "x"], ["--seeds", "3-1"], ["--seeds", ""], ["--seeds", "0-99999999"]])
def test_bad_numbers_are_a_usage_error(wrong: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert main(["export", str(tmp_path / "new"), *wrong]) == 2
    assert "such as 7,21-30" in capsys.readouterr().err


def test_exporting_leaves_the_whole_packs_unchanged(exported: Path) -> None:
    assert find_pack(7).solution.is_file()
    assert not (find_pack(7).folder / "scene7.public.json").exists()
