"""Tests that the error for a malformed argument names the quantity and its unit."""

from pathlib import Path

import pytest

from evaluator.commands.base import file_to_write, folder_to_write
from evaluator.commands.overview import COMMANDS
from evaluator.commands.program import main, parser
from tests.builders.cli_reference import listed


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("run", "--max-cost", "free"), "--max-cost: free is not an amount of money above 0, in US dollars"),
        (("run", "--max-cost", "0"), "--max-cost: 0 is not an amount of money above 0, in US dollars"),
        (("run", "--max-cost", "inf"), "--max-cost: inf is not an amount of money above 0, in US dollars"),
        (("run", "--max-time", "soon"), "--max-time: soon is not a time above 0, in seconds"),
        (("run", "--request-timeout", "-1"), "--request-timeout: -1 is not a time above 0, in seconds"),
        (("run", "--episode-timeout", "nan"), "--episode-timeout: nan is not a time above 0, in seconds"),
        (("run", "--max-tokens", "1e6"), "--max-tokens: 1e6 is not a whole number of tokens above 0"),
        (("run", "--reply-tokens", "0"), "--reply-tokens: 0 is not a whole number of tokens above 0"),
        (("run", "--epochs", "1.5"), "--epochs: 1.5 is not a whole number of epochs above 0"),
        (("run", "--concurrency", "all"), "--concurrency: all is not a whole number of episodes above 0"),
        (("run", "--max-calls", "-3"), "--max-calls: -3 is not a whole number of calls above 0"),
        (("run", "--temperature", "warm"), "--temperature: warm is not a temperature from 0 to 2"),
        (("run", "--temperature", "2.1"), "--temperature: 2.1 is not a temperature from 0 to 2"),
        (("play", "seven"), "N: seven is not the number of a scene"),
        (("play", "7", "--seed", "-1"), "--seed: -1 is not a seed, which is a whole number from 0"),
        (("play", "7", "--budget", "x"), "--budget: x is not a whole number of iterations above 0"),
        (("replay", "run", "--concurrency", "0"), "--concurrency: 0 is not a whole number of episodes above 0"),
        (("verify", "--seeds", "0"), "--seeds: 0 is not a whole number of seeds above 0"),
        (("verify", "--jobs", "0"), "--jobs: 0 is not a whole number of processes above 0"),
        (("scenes", "show", "x"), "N: x is not the number of a scene"),
    ],
    ids=" ".join,
)
def test_an_argument_of_the_wrong_kind_is_refused_in_its_own_unit(
    words: tuple[str, ...], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert sentence in capsys.readouterr().err


def test_the_values_in_a_study_file_are_checked_in_the_same_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.toml"
    file.write_text('max_cost = "free"\n', encoding="utf-8")
    assert main(["run", "--config", str(file)]) == 2
    assert "--max-cost: free is not an amount of money above 0, in US dollars" in capsys.readouterr().err


WRITES = [
    "run",
    "merge other",
    "report other",
    "referee",
    "play 7",
    "fork other --turn 1 --agent blind",
    "scenes pages",
    "export other --to inspect",
]
"""Commands whose `--out` is a folder."""


@pytest.mark.parametrize("words", WRITES)
def test_a_file_where_a_folder_is_to_be_written_is_refused_before_any_work(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("mine", encoding="utf-8")
    for out, what in ((file, "it"), (file / "below" / "it", str(file))):
        assert main([*words.split(), "--out", str(out)]) == 2
        said = f"physment-eval: {out} cannot be written: {what} is a file, and a folder is needed\n"
        assert capsys.readouterr() == ("", said)
    assert main([*words.split(), "--out", str(tmp_path / ("x" * 300))]) == 2
    assert capsys.readouterr().err.endswith(" cannot be written: File name too long\n")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
    assert file.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    "words",
    ["submit other --out", "export other --to parquet --out", "scenes list --html", "replay-original logs --out"],
)
def test_a_folder_where_a_file_is_to_be_written_is_refused_before_any_work(
    words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words.split(), str(tmp_path)]) == 2
    said = f"physment-eval: {tmp_path} cannot be written: it is a folder, and a file is needed\n"
    assert capsys.readouterr() == ("", said)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_that_names_what_is_written_is_checked_when_it_is_read(name: str) -> None:
    command = parser(name)[1][name]
    written = [
        action
        for one in (command, *(child for _, child in listed(command).values()))
        for action in one._actions
        if {"--out", "--keep", "--html"} & set(action.option_strings)
    ]
    if name != "export":  # whether it is a file or a folder depends on --to
        assert [action.dest for action in written if action.type not in {file_to_write, folder_to_write}] == []
