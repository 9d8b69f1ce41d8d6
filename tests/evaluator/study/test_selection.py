"""How options are read, and the sentence for each that is malformed."""

from pathlib import Path

import pytest

from evaluator.errors import UsageError
from evaluator.study.contenders import Team
from evaluator.study.selection import parse_numbers, parse_scenes
from scenes import list_packs


def ids(text: str | None) -> list[int]:
    return [files.scene_id for files in parse_scenes(text, None)]


def test_scenes_are_selected_by_id_range_and_category() -> None:
    everything = [files.scene_id for files in list_packs()]
    assert ids(None) == everything
    assert ids("7-111") == everything
    assert ids("21,7, 21") == [7, 21]
    assert ids("7-25") == [scene for scene in everything if scene <= 25]
    assert 7 in ids("category:easy-single")
    assert 21 not in ids("category:easy-single")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("999", "--scenes 999: there is no such scene; the scenes are 7, "),
        ("7,200-300", "--scenes 200-300: there is no such scene"),
        ("seven", "--scenes seven: write ids and ranges"),
        ("7-", "--scenes 7-: write ids"),
        ("-7", "--scenes -7: write ids"),
        ("", "write ids"),
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
    assert list(Team((name,)).build()) == [name]


@pytest.mark.parametrize("name", ["", "Reference", "oracle-once", "oracle-once:", "scripted", "model"])
def test_an_unknown_agent_is_refused_with_a_list_of_the_known_ones(name: str) -> None:
    with pytest.raises(UsageError, match="there is no such agent; the agents are reference, random, blind"):
        Team((name,)).build()


def test_an_argument_of_an_agent_that_takes_none_is_refused() -> None:
    with pytest.raises(UsageError, match="reference:x: there is no such agent"):
        Team(("reference:x",)).build()


def test_lists_and_ranges_of_numbers_are_read_without_repetition() -> None:
    assert parse_numbers("5,10,5", "--budgets", 1) == (5, 10)
    assert parse_numbers("0-3,2", "--seeds", 0) == (0, 1, 2, 3)


@pytest.mark.parametrize("text", ["0", "", "5,", "-1", "5.0", "ten", "3-1", "nan"])
def test_a_budget_that_is_not_a_whole_number_above_0_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--budgets"):
        parse_numbers(text, "--budgets", 1)
