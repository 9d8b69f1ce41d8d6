"""Tests of `watch` on a run that is being written: it reads each line once, changes no file, serves loopback only."""

import json
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.parse
import urllib.request
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import anyio
import anyio.lowlevel
import pytest
from pydantic import JsonValue

from evaluator.answers.keys import KeyRing
from evaluator.commands.program import main
from evaluator.episode.tracing import UNDERWAY, note_call, note_turn
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Usage
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.store import durable
from evaluator.store.run_folder import RunFolder
from evaluator.study.runner import Board
from evaluator.watch.followed_run import FollowedRun
from evaluator.watch.state import state_of
from scenes import find_pack, pack_hash
from tests.builders.records import VERSIONS, episode, episode_key, refused, turn

NOW = datetime(2026, 1, 1, 0, 10, tzinfo=UTC)
PLAN = Plan(scenes=(7, 21), agents=("x",), seeds=(0, 1))
RIGHT = 7.848


def ended(key: EpisodeKey, answer: JsonValue = RIGHT, *, ago_s: float = 10.0, **changes: Any) -> Episode:
    """Return an episode that lasted one second and ended some time before `NOW`."""
    began = NOW - timedelta(seconds=ago_s + 1)
    versions = VERSIONS.model_copy(update={"pack": pack_hash(find_pack(key.scene))})
    done = episode(turn("I look."), key=key, answer=answer, versions=versions)
    return done.model_copy(update={"started_at": began.isoformat(), **changes})


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    made = RunFolder(tmp_path / "run")
    made.create(resume=False)
    made.write_run(RunRecord(created_at="2026-01-01T00:00:00+00:00", plan=PLAN, server=ServerRecord(option="host")))
    return made


def state(run: FollowedRun) -> dict[str, Any]:
    run.look()
    found = state_of(run, NOW)
    json.dumps(found)
    return found


def test_episodes_appear_as_they_are_written_and_an_unfinished_line_waits(folder: RunFolder) -> None:
    run = FollowedRun(folder, KeyRing())
    assert (state(run)["phase"], state(run)["total"]) == ("waiting", 4)
    folder.append_episode(ended(episode_key(7)))
    found = state(run)
    assert (found["phase"], found["ended"]) == ("running", 1)
    assert (found["rows"][0]["correct"], found["rows"][0]["scored"], found["newest"][0]["verdict"]) == (1, 1, "correct")
    line = ended(episode_key(21), "no idea").model_dump_json().encode() + b"\n"
    with folder.episodes_file.open("ab") as stream:
        stream.write(line[:100])
        stream.flush()
        assert (state(run)["ended"], state(run)["notes"]) == (1, [])
        stream.write(line[100:])
    found = state(run)
    assert (found["ended"], found["rows"][0]["correct"], found["rows"][0]["share"]) == (2, 1, 0.5)
    assert found["rows"][0]["low"] == pytest.approx(0.0945, abs=1e-4), "Wilson's interval of 1 of 2"


def test_a_large_run_is_read_in_parts(folder: RunFolder) -> None:
    for key in PLAN.matrix():
        folder.append_episode(ended(key))
    run, seen = FollowedRun(folder, KeyRing()), list[tuple[int, bool]]()
    for _ in range(3):
        run.look(most=2)
        seen.append((len(run.episodes), run.behind))
    assert seen == [(2, True), (4, False), (4, False)]


def test_watching_changes_nothing_and_takes_no_lock(folder: RunFolder) -> None:
    folder.append_episode(ended(episode_key(7)))
    folder.path.chmod(0o555)
    before = {file.name: (file.stat().st_mtime_ns, file.read_bytes()) for file in folder.path.iterdir()}
    with folder.held():
        assert state(FollowedRun(folder, KeyRing()))["ended"] == 1
    assert {file.name: (file.stat().st_mtime_ns, file.read_bytes()) for file in folder.path.iterdir()} == before
    folder.path.chmod(0o755)


def test_damaged_lines_are_counted_until_they_are_set_aside(folder: RunFolder) -> None:
    folder.append_episode(ended(episode_key(7)))
    durable.append_line(folder.episodes_file, b'{"key": 1')
    folder.append_episode(ended(episode_key(21)))
    run = FollowedRun(folder, KeyRing())
    assert state(run)["ended"] == 2
    assert "1 lines of episodes.jsonl are damaged" in state(run)["notes"][0]
    folder.set_damage_aside()
    assert (state(run)["ended"], state(run)["notes"]) == (2, [])


def test_a_run_is_finished_quiet_or_running_and_a_repeated_episode_counts_once(folder: RunFolder) -> None:
    run = FollowedRun(folder, KeyRing())
    folder.append_episode(
        ended(episode_key(7), ago_s=300, outcome=Outcome.INFRASTRUCTURE_ERROR, answer=None, error="gone")
    )
    found = state(run)
    assert (found["phase"], found["quiet_s"]) == ("quiet", 300)
    assert (found["troubled"][0]["error"], found["rows"][0]["scored"]) == ("gone", 0)
    for key in PLAN.matrix():
        folder.append_episode(ended(key))
    found = state(run)
    assert (found["phase"], found["ended"], found["troubled"]) == ("finished", 4, [])


def test_an_episode_that_later_ones_overtook_is_named(folder: RunFolder) -> None:
    first, *later = PLAN.matrix()
    for number, key in enumerate(later):
        folder.append_episode(ended(key, ago_s=60 - 10 * number))
    (found,) = state(FollowedRun(folder, KeyRing()))["overtaken"]
    assert (found["scene"], found["seed"], found["by"], found["since_s"]) == (first.scene, first.seed, 3, 60)


def test_cost_refusals_and_open_worlds_stand_apart(folder: RunFolder) -> None:
    refusals = turn("", *(refused("step", duration=99.0) for _ in range(3)))
    used = Usage(input_tokens=1000, output_tokens=10, cost_usd=0.5)
    folder.append_episode(ended(episode_key(7)).model_copy(update={"turns": (refusals,), "usage": used}))
    folder.append_episode(ended(episode_key(201)))
    found = state(FollowedRun(folder, KeyRing()))
    assert [row["agent"] for row in found["rows"]] == ["x", "x, open worlds"]
    first = found["rows"][0]
    assert (first["calls"], first["refused"], first["tokens"], first["cost_usd"]) == (3, 1.0, 1010, 0.5)
    assert (found["total"], found["troubled"][0]["refused"]) == (None, 3), "scene 201 is not in the plan"


def test_what_cannot_be_graded_says_why(folder: RunFolder) -> None:
    folder.append_episode(ended(episode_key(7), versions=VERSIONS))
    found = state(FollowedRun(folder, KeyRing()))
    assert "scene 7 was played on another pack" in found["notes"][0]
    assert (found["newest"][0]["verdict"], found["rows"][0]["share"]) == (None, None)
    folder.append_episode(ended(episode_key(7)))
    held = state(FollowedRun(folder, KeyRing(), withheld=True))
    assert (held["withheld"], held["newest"][0]["verdict"], held["notes"]) == (True, None, [])


async def test_running_episodes_are_named_with_their_turn_and_the_file_is_gone_at_the_end(folder: RunFolder) -> None:
    run, board, key = FollowedRun(folder, KeyRing()), Board(folder), episode_key(7)
    async with anyio.create_task_group() as tasks:
        with board.shown(key):
            note_turn(2)
            note_call("step")
            tasks.start_soon(board.keep_written)
            while not folder.running_file.exists():
                await anyio.lowlevel.checkpoint()
            run.look()
            (one,) = state_of(run, datetime.now(UTC))["running"]
            assert (one["name"], one["turn"], one["call"]) == ("7 Speed of a dropped ball", 2, "step")
            # If the file has not changed for some time, the run counts as killed and no episode as running.
            assert state_of(run, datetime.now(UTC) + timedelta(minutes=1))["running"] == []
        tasks.cancel_scope.cancel()
    assert UNDERWAY.get() is None
    assert not folder.running_file.exists()
    assert state(run)["running"] == []


def test_the_course_is_the_accuracy_after_each_episode(folder: RunFolder) -> None:
    for key, answer, ago_s in ((episode_key(7), RIGHT, 30.0), (episode_key(7, seed=1), 1, 20.0)):
        folder.append_episode(ended(key, answer, ago_s=ago_s))
    ((name, points),) = [(line["agent"], line["points"]) for line in state(FollowedRun(folder, KeyRing()))["course"]]
    assert (name, points[0], points[-1]) == ("x", (0.0, 1.0), (10.0, 0.5))


def test_a_folder_that_is_no_run_is_refused_in_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "letters.txt").write_text("", encoding="utf-8")
    assert main(["watch", str(tmp_path), "--no-open"]) == 2
    said = capsys.readouterr().err
    assert "is not a run folder" in said
    assert said.count("\n") == 1


def test_a_port_in_use_is_refused_in_one_sentence(folder: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["watch", str(folder.path), "--no-open", "--port", str(port)]) == 2
    assert f"cannot listen on 127.0.0.1 port {port}" in capsys.readouterr().err


def reply(address: str, **headers: str) -> tuple[int, str]:
    try:
        with urllib.request.urlopen(urllib.request.Request(address, headers=headers), timeout=60) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def test_the_command_serves_the_page_to_who_has_the_token_and_ends_with_ctrl_c(folder: RunFolder) -> None:
    folder.append_episode(ended(episode_key(7)))
    command = [sys.executable, "-m", "evaluator", "watch", str(folder.path), "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().split(" at ")[1].split()[0]
            assert '<script src="watch.js"' in reply(address)[1]
            assert json.loads(reply(f"{address}state.json")[1])["ended"] == 1
            assert [reply(f"{address}{name}")[0] for name in ("watch.js", "watch.css")] == [200, 200]
            key = urllib.parse.quote(episode_key(7).model_dump_json())
            status, notebook = reply(f"{address}notebook?key={key}")
            assert (status, "Speed of a dropped ball" in notebook) == (200, True)
            assert reply(f"{address}notebook?key=1")[0] == 404
            assert reply(f"{address}run/report.html")[0] == 404
            folder.write_text(folder.report_file, "<p>the report")
            assert reply(f"{address}run/report.html") == (200, "<p>the report")
            assert reply(f"{address}run/../../secret")[0] == 404
            without = address.replace(address.split("/")[3], "guess")
            assert reply(f"{without}state.json")[0] == 404
            assert reply(address, Host="example.org")[0] == 403
            process.send_signal(signal.SIGINT)
            assert process.wait(timeout=60) == 0
            assert process.stderr is not None
            assert process.stderr.read() == ""
        finally:
            process.kill()


def test_a_run_that_does_not_exist_yet_is_waited_for(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "evaluator", "watch", str(tmp_path / "run"), "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            address = line.split(" at ")[1].split()[0]
            assert "no run has begun there yet" in line
            assert json.loads(reply(f"{address}state.json")[1]) == {"name": "run", "phase": "absent"}
            made = RunFolder(tmp_path / "run")
            made.create(resume=False)
            made.write_run(
                RunRecord(created_at="2026-01-01T00:00:00+00:00", plan=PLAN, server=ServerRecord(option="host"))
            )
            while (found := json.loads(reply(f"{address}state.json")[1]))["phase"] == "absent":
                pass
            assert (found["phase"], found["total"]) == ("waiting", 4)
        finally:
            process.kill()
