"""Tests of `verify`, `lint` and `scenes` as an author uses them."""

import json
import re
import shutil
import signal
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from evaluator.certify.records import CERTIFICATES_FILE
from evaluator.commands.program import main
from evaluator.store.run_folder import RunFolder
from scenes import default_folder, list_packs, read_pack
from tests.builders.commands import heed_signals, physment_eval

COMMAND = [sys.executable, "-m", "evaluator"]


@pytest.fixture
def packs(tmp_path: Path) -> Path:
    """A folder with two scenes of the suite."""
    for scene in (7, 21):
        shutil.copytree(default_folder() / f"Scene{scene}", tmp_path / f"Scene{scene}")
    return tmp_path


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")


def stored(packs: Path) -> dict[int, dict[str, Any]]:
    certificates = json.loads((packs / "certificates.json").read_text(encoding="utf-8"))
    return {one["scene"]: one for one in certificates["scenes"]}


def test_verify_writes_certificates_and_says_why_a_scene_is_not_sound(packs: Path) -> None:
    done = physment_eval("verify", "--scenes-dir", packs, "--seeds", "3", "--jobs", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert f"2 of 2 scenes are sound on MuJoCo {version('mujoco')}" in done.stdout
    assert {scene: len(one["checks"]) for scene, one in stored(packs).items()} == {7: 6, 21: 6}
    done = physment_eval("verify", "--scenes-dir", packs, "--seeds", "3")
    assert "2 scenes are sound and unchanged" in done.stdout
    assert "2 of 2 scenes are sound" in done.stdout
    before = stored(packs)[21]
    edit(packs / "Scene7" / "solution.py", '["velocity"][2]', '["velocity"][2] * 1.2')
    done = physment_eval("verify", "--scenes-dir", packs, "--scene", "7", "--seeds", "3", "--jobs", "1")
    assert done.returncode == 1
    assert "scene 7, key: seed 0: the reference" in done.stdout
    assert "0 of 1 scenes are sound" in done.stdout
    assert stored(packs)[21] == before
    assert not {check["name"]: check for check in stored(packs)[7]["checks"]}["key"]["passed"]


def test_an_interrupted_verify_keeps_what_it_has_proven(packs: Path) -> None:
    words = ("verify", "--scenes-dir", str(packs), "--seeds", "400", "--jobs", "2")
    edit(packs / "Scene7" / "solution.py", "yield [answer", "yield [answer[")  # ends at once, with a syntax error
    with subprocess.Popen(
        [*COMMAND, *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_signals,  # noqa: PLW1509 - two system calls
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("[1/2] scene 7: NOT SOUND")
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=300)
    assert process.returncode == 130
    assert "interrupted; the certificates of 1 scenes are in" in said
    assert "Traceback" not in said
    assert list(stored(packs)) == [7]


def test_lint_names_each_fault_and_verify_refuses_what_is_not_there(packs: Path) -> None:
    assert physment_eval("lint", "--scenes-dir", packs).returncode == 0
    edit(packs / "Scene21" / "scene21.json", '"reasoning"', '"reasonning"')
    done = physment_eval("lint", "--scenes-dir", packs)
    assert done.returncode == 1
    assert "scene 21: unknown field reasonning; did you mean reasoning?" in done.stdout
    assert "1 of 2 scenes without fault" in done.stdout
    done = physment_eval("verify", "--scenes-dir", packs, "--scene", "8")
    assert (done.returncode, "there is no such scene" in done.stderr) == (2, True)


def test_scenes_list_says_which_certificates_are_out_of_date(packs: Path) -> None:
    assert "none" in physment_eval("scenes", "list", "--scenes-dir", packs).stdout
    shutil.copy(default_folder() / CERTIFICATES_FILE, packs)
    assert physment_eval("scenes", "list", "--scenes-dir", packs).stdout.count("sound on 20 seeds") == 2
    edit(packs / "Scene7" / "solution.py", "FALL_S = 0.8\n", "FALL_S = 0.8  # as the task says\n")
    assert physment_eval("scenes", "list", "--scenes-dir", packs).stdout.count("sound on 20 seeds") == 2
    edit(packs / "Scene7" / "solution.py", "FALL_S = 0.8", "FALL_S = 0.7")
    lines = physment_eval("scenes", "list", "--scenes-dir", packs).stdout.splitlines()
    assert next(line for line in lines if line.split()[:1] == ["7"]).rstrip().endswith("changed since")


def test_list_and_run_say_on_which_engine_the_certificates_hold(packs: Path) -> None:
    shutil.copy(default_folder() / CERTIFICATES_FILE, packs)
    engine, folder = version("mujoco"), ("--scenes-dir", packs)
    edit(packs / CERTIFICATES_FILE, f'"engine": "{engine}"', '"engine": "0.1"')
    note = f"hold on MuJoCo 0.1, but {engine} is installed here"
    listed = physment_eval("scenes", "list", *folder).stdout
    assert ("certificate on MuJoCo 0.1" in listed, note in listed) == (True, True)
    # The note precedes the first episode: it is printed although this run cannot begin, for lack of a server.
    done = physment_eval("run", "--scenes", "7", "--server", "http://127.0.0.1:9", "--out", packs / "run", *folder)
    assert (done.returncode, note in done.stderr) == (2, True)


def test_scenes_list_shows_the_rung_of_each_scene_and_counts_the_scenes_and_sound_ones_of_each(packs: Path) -> None:
    shutil.copy(default_folder() / CERTIFICATES_FILE, packs)
    edit(packs / "Scene21" / "scene21.json", '"easy-single-hidden"', '"open"')
    lines = physment_eval("scenes", "list", "--scenes-dir", packs).stdout.splitlines()
    assert [line.split()[0] for line in lines if " open " in line] == ["21", "scenes"]
    assert lines[-1].rstrip() == "scenes by rung  easy 1 (1 sound)   open 1 (0 sound)"


def test_scenes_show_prints_the_private_half_only_when_asked() -> None:
    public = physment_eval("scenes", "show", "9", "--seed", "3").stdout
    private = physment_eval("scenes", "show", "9", "--seed", "3", "--private").stdout
    assert "# Scene:" in public
    assert "key at seed" not in public
    assert private.startswith(public)
    assert "key at seed 3:" in private
    assert "no scene 6; the scenes here are 7-111, 201-220" in physment_eval("scenes", "show", "6").stderr


@pytest.mark.parametrize(
    ("prompting", "protocol", "budget"), [("zero-shot", "native", 20), ("one-shot-cot", "text", 5)]
)
def test_scenes_show_prints_what_an_agent_of_a_run_is_told(
    prompting: str, protocol: str, budget: int, tmp_path: Path, host_url: str
) -> None:
    choice = ("--prompting", prompting, "--protocol", protocol)
    run = ("--agent", "blind", "--scenes", "26", "--seeds", "3", "--budgets", str(budget), "--out", "run")
    assert physment_eval("--server", host_url, *run, *choice, cwd=tmp_path).returncode == 0
    (episode,) = RunFolder(tmp_path / "run").episodes().values()
    shown = physment_eval("scenes", "show", "26", "--seed", "3", *choice, "--budget", str(budget))
    assert (shown.returncode, shown.stdout) == (0, f"{episode.prompt}\n")
    if budget == 20:
        assert physment_eval("scenes", "show", "26", "--seed", "3").stdout == shown.stdout


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("scene7.xml", 'type="sphere"', 'type="sfere"', "scene 7 cannot be opened: the scene's XML does not compile"),
        ("scene7.json", '"object_id": "1"', '"object_id": "2"', "scene 7 cannot be opened: "),
    ],
)
def test_scenes_show_says_in_a_sentence_why_a_scene_is_refused(
    packs: Path, file: str, old: str, new: str, said: str
) -> None:
    edit(packs / "Scene7" / file, old, new)
    shown = physment_eval("scenes", "show", "7", "--scenes-dir", packs)
    assert (shown.returncode, shown.stdout, shown.stderr.count("\n")) == (2, "", 1)
    assert shown.stderr.startswith(f"physment-eval: {said}")


def test_scenes_list_names_no_unit_where_an_answer_has_none() -> None:
    listed = physment_eval("scenes", "list", "--scenes", "7,15,57,70").stdout
    assert "None" not in listed
    assert "number [m/s]" in listed
    assert "they stay together" in " ".join(listed.split())


def test_scenes_list_breaks_no_word_in_a_terminal_of_80_columns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in (("FORCE_COLOR", "1"), ("TERM", "dumb"), ("COLUMNS", "80")):
        monkeypatch.setenv(name, value)
    assert main(["scenes", "list", "--scenes", "7-220"]) == 0
    shown = re.sub(r"\x1b\[[\d;]*m", "", capsys.readouterr().out)
    assert max(len(line) for line in shown.splitlines() if not line.startswith("difficulty ±")) <= 80
    for files in list_packs():
        pack = read_pack(files)
        words = {*pack.metadata.scene_name.split(), *([pack.category.value] if pack.category else [])}
        assert words <= set(shown.split()), files.scene_id


def test_a_new_scene_never_overwrites_an_existing_scene(tmp_path: Path) -> None:
    made = physment_eval("scenes", "new", "112", "--category", "hard-single-hidden", "--scenes-dir", tmp_path)
    assert made.returncode == 0
    assert "physment-eval verify --scenes-dir" in made.stdout
    again = physment_eval("scenes", "new", "112", "--category", "easy-single", "--scenes-dir", tmp_path)
    assert (again.returncode, "exists already; choose another id" in again.stderr) == (2, True)


def test_lint_says_what_is_not_laid_out_and_fix_lays_it_out(packs: Path) -> None:
    file = packs / "Scene7" / "scene7.json"
    laid_out = file.read_bytes()
    file.write_text(json.dumps(json.loads(laid_out), ensure_ascii=False), encoding="utf-8")
    said = physment_eval("lint", "--scenes-dir", packs)
    assert said.returncode == 0, "a layout is no fault"
    assert "scene 7: scene7.json is not laid out" in said.stdout
    assert f"1 not laid out; run: physment-eval lint --fix --scenes-dir {packs}" in said.stdout
    fixed = physment_eval("lint", "--fix", "--scenes-dir", packs)
    assert fixed.returncode == 0
    assert "scene 7: scene7.json is laid out now" in fixed.stdout
    assert file.read_bytes() == laid_out
    assert "laid out" not in physment_eval("lint", "--fix", "--scenes-dir", packs).stdout


def test_fix_refuses_what_it_cannot_parse(packs: Path) -> None:
    edit(packs / "Scene7" / "scene7.xml", "<worldbody>", "<worldbody>words")
    assert physment_eval("lint", "--scenes-dir", packs).returncode == 0
    done = physment_eval("lint", "--fix", "--scenes-dir", packs)
    assert done.returncode == 1
    assert "cannot be laid out: only elements and comments can be laid out, not 'words'" in done.stdout
    assert "1 of 2 scenes without fault" in done.stdout
