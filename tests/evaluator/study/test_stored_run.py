"""Tests that a run folder written before packs had content hashes is still read, graded, replayed and resumed.

A version of the code from that time played, graded and summarised `stored_run`, which is never regenerated. The folder
names packs by hashes of their bytes. `stored_packs` contains these packs, so that the suite may replace them.
"""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import anyio
import pytest

from evaluator.agents.recorded import RecordedAgent
from evaluator.certify.verify import MemoryConnector
from evaluator.commands.program import main
from evaluator.records.episode import Episode, Exchange, ToolCall, Turn
from evaluator.records.run import RunRecord
from evaluator.report.notebook import pictures
from evaluator.scores.dimensions import SCORING_VERSION
from evaluator.store.run_folder import RunFolder
from evaluator.study.replay import differences, replay, without_added
from evaluator.study.run_start import server_record
from scenes import find_pack, pack_hash, same_packs

STORED = Path(__file__).parent / "stored_run"
PACKS = Path(__file__).parent / "stored_packs"
FROM = ["--scenes-dir", str(PACKS)]
SCENES = (7, 21, 27, 101)
OPTIONS = ["--agent", "reference", "--agent", "random", "--scenes", "7,21,27,101", "--budgets", "5", "--seeds", "3"]


@pytest.fixture(scope="module")
def host_url() -> Generator[str]:
    """The address of a host that serves the stored packs."""
    command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--end-with-stdin", *FROM]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["listening"]
        process.terminate()


@pytest.fixture
def stored(tmp_path: Path) -> RunFolder:
    """A copy of the stored run."""
    return RunFolder(shutil.copytree(STORED, tmp_path / "stored"))


def play(out: Path, server: str, *words: str) -> int:
    return main(["run", *OPTIONS, *FROM, "--server", server, "--out", str(out), *words])


def test_the_stored_run_names_its_packs_by_bytes_and_they_are_those_of_today(stored: RunFolder) -> None:
    packs = stored.read_run().packs
    assert list(packs.values()) == ["125dc8c43267", "ae6134d1790e", "266a932bba03", "63c3793d85ce"]
    assert {episode.versions.pack for episode in stored.episodes().values()} == set(packs.values())
    assert same_packs(packs, [find_pack(scene, PACKS) for scene in SCENES])


def test_grading_it_gives_the_same_grades_and_the_same_numbers(
    stored: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["grade", str(stored.path), *FROM]) == 0
    said = capsys.readouterr().out
    assert "reference: strict accuracy 75.0 % (3/4)" in said
    assert "→" not in said
    before, now = RunFolder(STORED).grades(), stored.grades()
    assert {key: record.grade for key, record in now.items()} == {key: record.grade for key, record in before.items()}
    assert not list(stored.path.glob("grades.*.jsonl"))
    old, new = (json.loads(run.summary_file.read_text(encoding="utf-8")) for run in (RunFolder(STORED), stored))
    assert (old["format"], new["format"]) == (1, 3)
    # Format 2 counts calls of disabled tools in V; in format 3 episodes that do not define V or R count 0 in them.
    assert (old.get("scoring_version"), new["scoring_version"]) == (None, SCORING_VERSION)
    unchanged = {"n", "n_scored", "n_correct", "strict_accuracy", "normalised_accuracy", "c", "e", "outcomes"}
    for agent, group in old["by_agent"].items():
        assert {name: new["by_agent"][agent][name] for name in unchanged} == {name: group[name] for name in unchanged}


def test_its_report_names_its_scenes(stored: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(stored.path), *FROM]) == 0
    assert capsys.readouterr().out.strip() == str(stored.report_file)
    assert "Make one body of two" in stored.report_file.read_text(encoding="utf-8")


def test_the_pictures_of_its_packs_are_found_beside_them(stored: RunFolder, tmp_path: Path) -> None:
    packs = Path(shutil.copytree(PACKS, tmp_path / "packs"))
    pictured = tmp_path / "docs" / "reference" / "scenes" / "small"
    pictured.mkdir(parents=True)
    for scene in SCENES[:2]:
        (pictured / f"scene{scene}.png").write_bytes(b"picture")
    played = stored.read_run().packs
    assert pictures(played, packs) == {7: b"picture", 21: b"picture"}
    assert pictures(played | {"7": "ffffffffffff"}, packs) == {21: b"picture"}


def test_replaying_it_finds_no_difference(stored: RunFolder, host_url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(stored.path), "--server", host_url, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["episodes"], said["calls"], said["differences"], said["not_played"]) == (8, 81, [], [])


def test_it_is_resumed_and_then_holds_episodes_under_both_kinds_of_hash(stored: RunFolder, host_url: str) -> None:
    lines = stored.episodes_file.read_text(encoding="utf-8").splitlines(keepends=True)
    stored.episodes_file.write_text("".join(lines[:-1]), encoding="utf-8")
    assert play(stored.path, host_url, "--resume") == 0
    *older, last = stored.episodes().values()
    assert last.versions.pack == pack_hash(find_pack(last.key.scene, PACKS))
    assert len(older) == 7
    assert not [episode for episode in older if episode.versions.pack.startswith("c1:")]
    assert stored.read_run().packs == RunFolder(STORED).read_run().packs
    assert main(["grade", str(stored.path), *FROM]) == 0


def test_a_run_of_another_pack_is_not_resumed(
    stored: RunFolder, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    record = stored.read_run()
    stored.write_run(record.model_copy(update={"packs": record.packs | {"7": "ffffffffffff"}}))
    assert play(stored.path, host_url, "--resume") == 2
    assert "holds a run with other packs; --resume needs the same" in capsys.readouterr().err


def test_it_is_compared_reported_and_merged_with_a_run_of_today(
    stored: RunFolder, tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    today = RunFolder(tmp_path / "today")
    assert play(today.path, host_url) == 0
    assert all(name.startswith("c1:") for name in today.read_run().packs.values())
    assert main(["grade", str(stored.path), *FROM]) == 0
    capsys.readouterr()
    chosen = ["--a", "agent=reference", "--b", "agent=reference", *FROM]
    assert main(["compare", str(stored.path), str(today.path), *chosen, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["strict"]["n"] == 4
    assert main(["report", str(stored.path), str(today.path), "--out", str(tmp_path / "both"), *FROM]) == 0
    page = (tmp_path / "both" / "report.html").read_text(encoding="utf-8")
    assert "Not all of these were played on the same packs" not in page
    # `merge` refuses two different records of one episode, so each run keeps a different half of the episodes.
    for folder, half in ((stored, slice(0, 4)), (today, slice(4, 8))):
        lines = folder.episodes_file.read_text(encoding="utf-8").splitlines(keepends=True)
        folder.episodes_file.write_text("".join(sorted(lines)[half]), encoding="utf-8")
    merged = ["--out", str(tmp_path / "merged"), "--allow-modified", *FROM]
    assert main(["merge", str(stored.path), str(today.path), *merged]) == 0
    assert len(RunFolder(tmp_path / "merged").episodes()) == 8


# Replay under another tool contract


def first_velocity(episode: Episode, change: Callable[[dict[str, Any]], dict[str, Any]]) -> Episode:
    """The stored episode of the reference agent in scene 7, with a changed result of `get_velocity`."""
    plain = episode.model_dump(mode="json")
    exchange = plain["turns"][0]["exchanges"][1]
    assert exchange["call"]["tool"] == "get_velocity"
    exchange["content"] = change(exchange["content"])
    return Episode.model_validate(plain)


def with_less(content: dict[str, Any]) -> dict[str, Any]:
    """Return a result without `velocity`, as if a later version of the tools had added it."""
    return {name: value for name, value in content.items() if name != "velocity"}


def with_more(content: dict[str, Any]) -> dict[str, Any]:
    """Return a result with `speed`, as if a later version of the tools had removed it."""
    return content | {"speed": 1.0}


def with_another_value(content: dict[str, Any]) -> dict[str, Any]:
    return content | {"velocity": [0.0, 0.0, -1.0]}


OTHER = "0" * 16
"""The tool contract of no server."""


@pytest.fixture(scope="module")
def today(tmp_path_factory: pytest.TempPathFactory, host_url: str) -> RunFolder:
    """The stored run, played again by the present code. Tests copy it before they change it."""
    folder = RunFolder(tmp_path_factory.mktemp("today") / "run")
    assert play(folder.path, host_url) == 0
    return folder


@pytest.fixture(scope="module")
def present() -> str:
    """The tool contract of today."""

    async def asked() -> str:
        async with MemoryConnector(PACKS).open(7, 0) as client:
            return (await server_record(client, option="")).tool_schema_hash

    return anyio.run(asked)


def recorded_under(folder: RunFolder, contract: str) -> None:
    record = folder.read_run()
    server = record.server.model_copy(update={"tool_schema_hash": contract})
    folder.write_run(record.model_copy(update={"server": server}))


@pytest.mark.parametrize("contracts", [(), ("present",), (OTHER,), ("present", OTHER)])
@pytest.mark.parametrize(
    ("change", "different"),
    [
        (with_less, "get_velocity: velocity"),
        (with_more, "get_velocity: speed"),
        (with_another_value, "get_velocity: velocity[2]"),
    ],
)
async def test_only_under_another_tool_contract_may_a_return_have_more_fields_than_its_record(
    contracts: tuple[str, ...], change: Callable[[dict[str, Any]], dict[str, Any]], different: str, present: str,
    today: RunFolder,
) -> None:  # fmt: skip
    (episode,) = [episode for key, episode in today.episodes().items() if (key.scene, key.agent) == (7, "reference")]
    agent = RecordedAgent("replay:stored", (first_velocity(episode, change),))
    known = frozenset(present if contract == "present" else contract for contract in contracts)
    (found,) = await replay(agent, MemoryConnector(PACKS), contracts=known)
    added = OTHER in contracts and change is with_less
    assert [difference.what for difference in found.differences] == ([] if added else [different])
    assert found.added == ({different: 1} if added else {})


def test_the_command_reads_the_contract_from_the_run_and_names_what_was_added_since(
    today: RunFolder, tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = RunFolder(shutil.copytree(today.path, tmp_path / "copy"))
    episodes = [
        first_velocity(episode, with_less) if (key.scene, key.agent) == (7, "reference") else episode
        for key, episode in stored.episodes().items()
    ]
    stored.episodes_file.unlink()
    for episode in episodes:
        stored.append_episode(episode)
    assert main(["replay", str(stored.path), "--server", host_url]) == 1
    assert "7 episodes the same, 1 differences" in capsys.readouterr().out
    recorded_under(stored, OTHER)
    assert main(["replay", str(stored.path), "--server", host_url]) == 0
    said = capsys.readouterr().out
    assert "added since the record, and not compared: get_velocity: velocity (× 1)" in said
    assert "8 episodes the same, 0 differences" in said
    assert main(["replay", str(stored.path), "--server", host_url, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["added_since"] == {"get_velocity: velocity": 1}


def test_added_fields_are_found_inside_objects_and_lists() -> None:
    def episode(content: dict[str, Any]) -> Episode:
        exchange = Exchange(call=ToolCall(tool="look", arguments={}), returned=True, content=content)
        turn = Turn(reasoning="", exchanges=(exchange, exchange))
        return next(iter(RunFolder(STORED).episodes().values())).model_copy(update={"turns": (turn,)})

    before = episode({"a": {"b": 1}, "c": [{"d": 1}, {"d": 2}], "e": [1]})
    after = episode({"a": {"b": 1, "new": 2}, "c": [{"d": 1, "new": 3}, {"d": 2, "new": 4}], "e": [1, 2]})
    now, added = without_added(before, after)
    assert added == {"look: a.new": 2, "look: c.new": 4}
    _, added = without_added(before, after.model_copy(update={"prompt": "another"}))
    assert added["opening prompt"] == 1
    assert [difference.what for difference in differences(before, now)] == ["look: e", "look: e"]


def test_a_run_was_recorded_with_the_contracts_of_its_server_its_resumptions_and_its_parts() -> None:
    def start(contract: str) -> dict[str, Any]:
        return {"created_at": "", "server": {"option": "", "tool_schema_hash": contract}}

    plan = {"scenes": [], "agents": []}
    merged = [start("b") | {"folder": ""}, start("c") | {"folder": "", "resumed": [start("d")]}]
    record = start("a") | {"plan": plan, "resumed": [start("e")], "merged": merged}
    assert RunRecord.model_validate(record).tool_contracts() == set("abcde")
    assert RunRecord.model_validate(start("") | {"plan": plan}).tool_contracts() == set()
