"""Tests that plugin commands are found by entry points, and that one sentence names a missing or broken plugin."""

from pathlib import Path

import pytest

from evaluator.commands.overview import COMMANDS_GROUP, EXPORTS_GROUP, plugin
from evaluator.commands.program import main
from evaluator.errors import UsageError


def test_a_missing_plugin_is_named_with_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("evaluator.commands.overview.entry_points", lambda **_: ())
    assert main(["harbor", "write", "tasks"]) == 2
    assert capsys.readouterr() == (
        "",
        "physment-eval: harbor needs the plugin physment-harbor, which is not installed: in a checkout, pip install"
        " ./integrations/harbor\n",
    )


def test_a_plugin_that_cannot_be_imported_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    described = tmp_path / "broken-1.dist-info"
    described.mkdir()
    (described / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 1\n", encoding="utf-8")
    lines = f"[{EXPORTS_GROUP}]\nbroken = no_such_module:write\nsound = json:dumps\n"
    (described / "entry_points.txt").write_text(lines, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(UsageError, match=r"plugin no_such_module:write cannot be imported: No module named"):
        plugin(EXPORTS_GROUP, "broken", "export --to broken")
    assert plugin(EXPORTS_GROUP, "sound", "export --to sound")([1]) == "[1]"
    with pytest.raises(UsageError, match=r"pip install \./integrations/sound"):
        plugin(COMMANDS_GROUP, "sound", "sound")  # a name counts in its own group


def test_help_lists_the_command_of_a_plugin_that_is_not_installed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("evaluator.commands.overview.entry_points", lambda **_: ())
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "(plugin physment-harbor)" in " ".join(capsys.readouterr().out.split())
