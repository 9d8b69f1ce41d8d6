"""The error for a malformed argument names the quantity and its unit."""

from pathlib import Path

import pytest

from evaluator.commands.program import main


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
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err


def test_the_values_in_a_study_file_are_checked_in_the_same_way(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.toml"
    file.write_text('max_cost = "free"\n', encoding="utf-8")
    with pytest.raises(SystemExit):
        main(["run", "--config", str(file)])
    assert "--max-cost: free is not an amount of money above 0, in US dollars" in capsys.readouterr().err
