"""The tutorial of a policy that learns: its program is run as the page has it, for fewer updates."""

import ast
import re
import subprocess
import sys
from pathlib import Path

from tests.builders.paths import DOCS

PAGE = (DOCS / "tutorials" / "a-policy-that-learns.md").read_text(encoding="utf-8")
UPDATES = 180
"""A quarter of those of the page: enough for two of the three scenes."""


def shares(printed: str, words: str) -> dict[int, float]:
    found = re.search(rf"^{words} (\{{.*\}})$", printed, re.MULTILINE)
    assert found is not None, printed
    return ast.literal_eval(found[1])


def test_the_policy_gets_better_than_random_play(tmp_path: Path) -> None:
    (program,) = re.findall(r"`learn\.py`:\n\n```python\n(.*?)```", PAGE, flags=re.DOTALL)
    (tmp_path / "learn.py").write_text(program, encoding="utf-8")
    command = [sys.executable, "learn.py", "--seed", "10", "--updates", str(UPDATES)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    trained, limits = shares(done.stdout, "trained"), shares(done.stdout, "its 99 % quantile")
    assert all(trained[scene] > limits[scene] for scene in (7, 9)), done.stdout


def test_every_row_of_the_table_is_above_the_quantile_of_random_play() -> None:
    limits = shares(PAGE, "its 99 % quantile")
    rows = re.findall(r"^\| (\d+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", PAGE, re.MULTILINE)
    assert len(rows) == 5
    assert all(float(share) > limits[scene] for row in rows for scene, share in zip((7, 9, 14), row[1:], strict=True))
