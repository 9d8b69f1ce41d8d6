"""Tests of the how-to page on terms: its program adds a form, and the form acts as the page says."""

import re
import subprocess
import sys
from pathlib import Path

from tests.builders.paths import DOCS

PAGE = DOCS / "how-to" / "add-a-term.md"


def test_following_the_page_adds_a_form_that_the_engine_and_numpy_agree_on(tmp_path: Path) -> None:
    page = PAGE.read_text(encoding="utf-8")
    ((name, program),) = re.findall(r"^```python file=(\S+)\n(.*?)^```$", page, re.DOTALL | re.MULTILINE)
    form = re.search(r"^JET = .*?^\)$", program, re.DOTALL | re.MULTILINE)
    assert form is not None
    assert len(form[0].splitlines()) <= 30
    (tmp_path / name).write_text(program, encoding="utf-8")
    done = subprocess.run([sys.executable, name], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    gap, change = (float(number) for number in re.findall(r" by (?:up to )?(\S+)", done.stdout))
    assert gap < 0.01
    assert change > 0.1


def test_what_the_page_names_is_there() -> None:
    page = PAGE.read_text(encoding="utf-8")
    files = re.findall(r"`(scenes/\S+\.py)`", page)
    texts = {file: (DOCS.parent / file).read_text(encoding="utf-8") for file in files}
    for name, file in (("_ALIKE", "drawing"), ("GRAMMAR", "levels"), ("PLANE", "plane"), ("Modulation", "modulations")):
        assert name in page
        assert name in texts[f"scenes/worlds/{file}.py"]
