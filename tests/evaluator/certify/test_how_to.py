"""Tests of docs/how-to/contribute-a-scene.md: its commands succeed, and its files make a sound scene."""

import re
import shlex
from pathlib import Path

from tests.builders.commands import physment_eval
from tests.builders.paths import DOCS

PAGE = DOCS / "how-to" / "contribute-a-scene.md"


def test_following_the_how_to_gives_a_certified_scene(tmp_path: Path) -> None:
    blocks = re.findall(
        r"^```(\w+)(?: file=(\S+))?\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    assert [file for _, file, _ in blocks if file] == ["scene200.xml", "scene200.json", "solution.py"]
    for kind, file, text in blocks:
        if file:
            (tmp_path / "my-scenes" / "Scene200" / file).write_text(text, encoding="utf-8")
            continue
        assert kind == "sh"
        for command in text.splitlines():
            program, *arguments = shlex.split(command)
            assert program == "physment-eval"
            done = physment_eval(*arguments, cwd=tmp_path)
            assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    assert "A cart in thick air" in (tmp_path / "my-run" / "report.html").read_text(encoding="utf-8")
