"""Tests that a submission matches its run folder, and that every change of either is refused with the difference."""

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from evaluator.commands.program import main
from evaluator.records.episode import Episode, Frame
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import Sealing


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, host_url: str) -> Path:
    """A run with right and wrong answers, and its submission."""
    folder = tmp_path_factory.mktemp("submitted") / "run"
    # One at a time, because episodes are stored in the order in which they end.
    agents = ["--agent", "reference", "--agent", "blind", "--concurrency", "1"]
    assert main(["run", *agents, "--scenes", "7,8", "--seeds", "0,3", "--server", host_url, "--out", str(folder)]) == 0
    assert main(["submit", str(folder)]) == 0
    return folder


@pytest.fixture
def folder(played: Path, tmp_path: Path) -> RunFolder:
    return RunFolder(shutil.copytree(played, tmp_path / "run"))


@pytest.fixture
def check(folder: RunFolder, host_url: str, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    def checked(other: RunFolder = folder) -> tuple[int, str]:
        capsys.readouterr()
        file = folder.path / "submission.json"
        code = main(["check-submission", str(file), str(other.path), "--server", host_url])
        printed = capsys.readouterr()
        said = (printed.err or printed.out).strip()
        assert "\n" not in said
        return code, said

    return checked


def edit(file: Path, change: Callable[[dict[str, Any]], object]) -> None:
    content = json.loads(file.read_text(encoding="utf-8"))
    change(content)
    file.write_text(json.dumps(content), encoding="utf-8")


def rewrite(folder: RunFolder, change: Callable[[Episode], Episode]) -> None:
    """Change the first episode, then seal, grade and submit the run again."""
    first, *rest = folder.episodes().values()
    folder.episodes_file.unlink()
    folder.seal_file.unlink()
    sealing = Sealing(folder)
    for episode in (change(first), *rest):
        folder.append_episode(episode)
        sealing.add(episode.model_dump_json().encode())
    folder.write_seal(sealing.seal)
    assert main(["grade", str(folder.path)]) == 0
    assert main(["submit", str(folder.path)]) == 0


def test_a_submission_is_confirmed_by_its_run_folder(folder: RunFolder, check: Callable[..., tuple[int, str]]) -> None:
    submission = json.loads((folder.path / "submission.json").read_text(encoding="utf-8"))
    seal = folder.read_seal()
    assert seal is not None
    assert submission["seal"]["head"] == seal.head
    assert submission["summary"] == json.loads(folder.summary_file.read_text(encoding="utf-8"))
    code, said = check()
    assert code == 0, said
    assert "8 episodes graded again" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda file: file["summary"]["overall"].update(strict_accuracy=1.0), "summary.overall.strict_accuracy is 1.0"),
        (lambda file: file["run"]["plan"].update(budgets=[5]), "run.plan.budgets[0] is 5"),
        (lambda file: file["run"]["packs"].update({"7": "0"}), "run.packs.7 is '0'"),
        (lambda file: file["seal"].update(head="0"), "seal.head is '0'"),
        (lambda file: file.update(verdicts_sha256="0"), "verdicts_sha256 is '0'"),
        (lambda file: file.update(unsealed_episodes=1), "unsealed_episodes is 1"),
        (lambda file: file.update(seed_commitment="0"), "seed_commitment is '0'"),
        (lambda file: file.pop("summary"), "is no submission: summary"),
        (lambda file: file.update(format=2), "is no submission: format"),
    ],
)
def test_an_edited_figure_is_named(
    folder: RunFolder, check: Callable[..., tuple[int, str]], change: Callable[[dict[str, Any]], object], said: str
) -> None:
    edit(folder.path / "submission.json", change)
    code, sentence = check()
    assert code == 2
    assert said in sentence


def test_an_edited_record_is_refused(folder: RunFolder, check: Callable[..., tuple[int, str]]) -> None:
    lines = folder.episodes_file.read_bytes()
    folder.episodes_file.write_bytes(lines.replace(b'"outcome":"answered"', b'"outcome":"budget_exhausted"', 1))
    code, sentence = check()
    assert code == 2
    assert "the sealed episodes have been changed" in sentence


def test_an_edited_grade_is_refused(folder: RunFolder, check: Callable[..., tuple[int, str]]) -> None:
    grades = folder.grades_file.read_text(encoding="utf-8")
    folder.grades_file.write_text(grades.replace('"strict":"incorrect"', '"strict":"correct"', 1), encoding="utf-8")
    code, sentence = check()
    assert code == 2
    assert "grading again gives incorrect" in sentence
    assert main(["submit", str(folder.path)]) == 2


def test_another_folder_is_refused(
    folder: RunFolder, check: Callable[..., tuple[int, str]], tmp_path: Path, host_url: str
) -> None:
    other = RunFolder(tmp_path / "other")
    agents = ["--agent", "reference", "--agent", "blind"]
    words = ["run", *agents, "--scenes", "7,8", "--seeds", "0,4", "--server", host_url, "--out", str(other.path)]
    assert main(words) == 0
    code, sentence = check(other)
    assert code == 2
    assert "does not state the results of" in sentence


def test_a_forged_answer_is_found_by_the_replay(folder: RunFolder, check: Callable[..., tuple[int, str]]) -> None:
    """The run is sealed, graded and submitted again after the change, so only the replay can detect it."""
    rewrite(folder, lambda episode: episode.model_copy(update={"answer": 7.8, "prompt": episode.prompt}))
    code, sentence = check()
    assert (code, "answer: recorded 7.8" in sentence) == (1, True), sentence


def test_a_forged_reading_is_found_by_the_replay(folder: RunFolder, check: Callable[..., tuple[int, str]]) -> None:
    def forge(episode: Episode) -> Episode:
        content = json.loads(episode.model_dump_json())
        exchange = next(one for turn in content["turns"] for one in turn["exchanges"] if "velocity" in one["text"])
        exchange["content"]["sim_time"] += 0.5
        return Episode.model_validate(content)

    rewrite(folder, forge)
    code, sentence = check()
    assert code == 1
    assert "sim_time" in sentence


def test_a_sealed_forgery_that_fits_the_laboratory_passes_and_the_help_says_so(
    folder: RunFolder, check: Callable[..., tuple[int, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    """No agent gave the forged answer, but the recorded result is what the laboratory would return for it."""

    def forge(episode: Episode) -> Episode:
        content, given = json.loads(episode.model_dump_json()), json.dumps(episode.answer)
        last = content["turns"][-1]["exchanges"][-1]
        content["turns"][-1]["exchanges"][-1] = json.loads(json.dumps(last).replace(given, "0.125"))
        return Episode.model_validate({**content, "answer": 0.125})

    rewrite(folder, forge)
    assert next(iter(folder.episodes().values())).answer == 0.125
    assert check()[0] == 0
    with pytest.raises(SystemExit):
        main(["check-submission", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "the seal is a checksum without a secret, so whoever forges a run can seal it again" in said
    assert "Forged readings are found by the replay alone, in a place that you trust" in said
    assert "it is true" not in said


def test_a_frame_that_the_records_do_not_name_is_refused(folder: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    frame = Frame.of(b"what was seen")

    def shown(episode: Episode) -> Episode:
        turn = episode.turns[0]
        exchange = turn.exchanges[0].model_copy(update={"frames": (frame,)})
        first = turn.model_copy(update={"exchanges": (exchange, *turn.exchanges[1:])})
        return episode.model_copy(update={"turns": (first, *episode.turns[1:])})

    rewrite(folder, shown)
    file = folder.frames_folder / f"{frame.name}.png"
    file.write_bytes(b"something else")
    capsys.readouterr()
    assert main(["submit", str(folder.path)]) == 2
    assert "is not the frame that the records name" in capsys.readouterr().err
    file.unlink()
    assert main(["submit", str(folder.path)]) == 2


@pytest.mark.parametrize("lost", ["an episode", "the seal", "the grades"])
def test_a_run_that_is_not_whole_is_not_submitted(
    folder: RunFolder, lost: str, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    if lost == "the seal":
        folder.seal_file.unlink()
    elif lost == "the grades":
        folder.grades_file.unlink()
    else:
        rest = list(folder.episodes().values())[1:]
        folder.episodes_file.unlink()
        folder.seal_file.unlink()
        sealing = Sealing(folder)
        for episode in rest:
            folder.append_episode(episode)
            sealing.add(episode.model_dump_json().encode())
        folder.write_seal(sealing.seal)
    assert main(["submit", str(folder.path)]) == 2
    said = {
        "an episode": "lacks 1 of 8 episodes, the first of them scene 7",
        "the seal": "is not sealed",
        "the grades": "not every episode is graded",
    }
    assert said[lost] in capsys.readouterr().err


def test_a_run_of_a_program_is_confirmed_too(tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Episodes of a program have one turn per call, and another prompt than episodes of the evaluator's agent loop."""
    program = tmp_path / "agent.py"
    program.write_text(
        "import sys, anyio\nfrom mcp import Client\n\nasync def play(url):\n    async with Client(url) as laboratory:\n"
        "        for _ in range(3):\n            await laboratory.call_tool('step', {'duration': 0.1})\n"
        "        await laboratory.call_tool('answer', {'answer': 1.0})\n\nanyio.run(play, sys.argv[1])\n",
        encoding="utf-8",
    )
    run = tmp_path / "run"
    options = ["--agent", "external", "--server", host_url, "--scenes", "7", "--budgets", "2", "--out", str(run)]
    assert main(["run", *options, "--", sys.executable, str(program), "{mcp_url}"]) == 0
    assert main(["submit", str(run)]) == 0
    assert main(["check-submission", str(run / "submission.json"), str(run), "--server", host_url]) == 0
    assert "1 episodes graded again, 4 calls replayed" in capsys.readouterr().out
