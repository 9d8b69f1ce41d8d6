"""Tests of the parsing of `--scenes`, `--seeds`, `--budgets` and `--split`, and of their error messages."""

import json
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.errors import UsageError
from evaluator.study.run_config import RunConfig, participants_of
from evaluator.study.selection import parse_numbers, parse_scenes
from scenes import find_pack, list_packs


def ids(text: str | None) -> list[int]:
    return [files.scene_id for files in parse_scenes(text, None)]


def test_scenes_are_selected_by_id_range_and_category() -> None:
    everything = [files.scene_id for files in list_packs()]
    assert ids(None) == everything
    assert ids("7-111") == [scene for scene in everything if scene <= 111] == ids("all")
    assert ids("21,7, 21") == [7, 21]
    assert ids("7-25") == [scene for scene in everything if scene <= 25]
    assert 7 in ids("category:easy-single")
    assert 21 not in ids("category:easy-single")


def pack(folder: Path, scene: int, category: str | None) -> None:
    """Write a pack with a category and otherwise arbitrary content."""
    (folder / f"Scene{scene}").mkdir()
    content = json.loads((find_pack(7).json).read_text(encoding="utf-8")) | {"category": category}
    (folder / f"Scene{scene}" / f"scene{scene}.json").write_text(json.dumps(content), encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (None, [1, 2, 3, 4, 201, 202]),
        ("all", [1, 2, 3, 4]),
        ("easy", [1]),
        ("hard", [2, 3]),
        ("open", [201, 202]),
        ("category:open", [201, 202]),
        ("all,201", [1, 2, 3, 4, 201]),
        ("3-201", [3, 4, 201]),
    ],
)
def test_all_leaves_out_open_worlds_unless_they_are_named(
    tmp_path: Path, text: str | None, expected: list[int]
) -> None:
    categories = {1: "easy-single", 2: "hard-multi", 3: "create-delete-attach", 4: None, 201: "open", 202: "open"}
    for scene, category in categories.items():
        pack(tmp_path, scene, category)
    assert [files.scene_id for files in parse_scenes(text, tmp_path)] == expected


def test_a_run_plays_no_open_world_unless_it_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pack(tmp_path, 7, "easy-single")
    pack(tmp_path, 201, "open")
    for words, scenes in (((), 1), (("--scenes", "open"), 1), (("--scenes", "all,open"), 2)):
        assert main(["run", "--scenes-dir", str(tmp_path), "--dry-run", *words]) == 0
        assert f"{scenes} scenes × 1 agents" in capsys.readouterr().out


def test_for_a_folder_of_open_worlds_the_error_says_how_to_select_them(tmp_path: Path) -> None:
    pack(tmp_path, 201, "open")
    with pytest.raises(UsageError, match="every scene here is an open world; select them with --scenes open"):
        parse_scenes("all", tmp_path)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("999", "--scenes 999: there is no such scene; the scenes are 7-111"),
        ("7,300-400", "--scenes 300-400: there is no such scene"),
        ("seven", "--scenes seven: write ids and ranges"),
        ("7-", "--scenes 7-: write ids"),
        ("-7", "--scenes -7: write ids"),
        ("", "write ids"),
        ("hard,simple", "--scenes simple: write ids and ranges such as 7,9,20-30, all, easy, hard, open, or category:"),
        ("category:simple", "the categories are easy-single, "),
    ],
)
def test_a_selection_that_is_malformed_or_empty_is_refused(text: str, problem: str) -> None:
    with pytest.raises(UsageError) as refused:
        parse_scenes(text, None)
    assert problem in str(refused.value)


def test_a_folder_without_packs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no scene packs"):
        parse_scenes(None, tmp_path)
    with pytest.raises(UsageError, match="no such folder"):
        parse_scenes(None, tmp_path / "none")


@pytest.mark.parametrize(
    "name", ["reference", "random", "blind", "oracle-once:reference", "oracle-once:oracle-once:blind"]
)
def test_agents_are_found_by_name(name: str) -> None:
    assert list(participants_of(RunConfig(agents=(name,)))) == [name]


@pytest.mark.parametrize("name", ["", "Reference", "oracle-once", "oracle-once:", "scripted", "model"])
def test_an_unknown_agent_is_refused_with_a_list_of_the_known_ones(name: str) -> None:
    with pytest.raises(UsageError, match="there is no such agent; the agents are reference, grammar, random, blind"):
        participants_of(RunConfig(agents=(name,)))


def test_an_argument_of_an_agent_that_takes_none_is_refused() -> None:
    with pytest.raises(UsageError, match="reference:x: there is no such agent"):
        participants_of(RunConfig(agents=("reference:x",)))


def test_lists_and_ranges_of_numbers_are_read_without_repetition() -> None:
    assert parse_numbers("5,10,5", "--budgets", 1) == (5, 10)
    assert parse_numbers("0-3,2", "--seeds", 0) == (0, 1, 2, 3)


@pytest.mark.parametrize("text", ["0", "", "5,", "-1", "5.0", "ten", "3-1", "nan"])
def test_a_budget_that_is_not_a_whole_number_above_0_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--budgets"):
        parse_numbers(text, "--budgets", 1)
