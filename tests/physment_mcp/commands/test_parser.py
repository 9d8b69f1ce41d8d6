"""Mistyped words of the command line of the laboratory."""

import pytest

from physment_mcp.commands.program import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["sevre"], "there is no command sevre; did you mean serve? (see physment-mcp --help)"),
        (["--scne", "7"], "there is no option --scne; did you mean --scene? (see physment-mcp --help)"),
        (["serve", "--prt", "8"], "there is no option --prt; did you mean --port? (see physment-mcp serve --help)"),
        (["--scene", "seven"], "argument --scene: seven is not a whole number (see physment-mcp --help)"),
        (["--timestep", "x"], "argument --timestep: x is not a number above 0 (see physment-mcp --help)"),
    ],
)
def test_a_mistyped_word_is_answered_with_the_nearest_in_one_sentence(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert capsys.readouterr() == ("", f"physment-mcp: {said}\n")
