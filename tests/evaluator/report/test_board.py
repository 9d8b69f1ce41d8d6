"""Tests of the leaderboard page: which submissions are ranked together, its columns, and its layout in Chromium."""

import json
from pathlib import Path
from typing import Any

import pytest

from evaluator.commands.program import main
from tests.builders.chromium import Page


@pytest.fixture(scope="module")
def submission(tmp_path_factory: pytest.TempPathFactory, host_url: str) -> dict[str, Any]:
    """The content of `submission.json` for a run of two agents."""
    folder = tmp_path_factory.mktemp("board") / "run"
    agents = ["--agent", "reference", "--agent", "blind"]
    assert main(["run", *agents, "--scenes", "7,8", "--server", host_url, "--out", str(folder)]) == 0
    assert main(["submit", str(folder)]) == 0
    return json.loads((folder / "submission.json").read_text(encoding="utf-8"))


def written(folder: Path, **submissions: dict[str, Any]) -> Path:
    folder.mkdir()
    for name, content in submissions.items():
        (folder / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


def changed(submission: dict[str, Any], **run: Any) -> dict[str, Any]:
    return submission | {"run": submission["run"] | run}


def test_model_and_scaffold_have_columns_of_their_own(submission: dict[str, Any], tmp_path: Path) -> None:
    agents = {"reference": {"provider": "openai", "model": "<b>gpt</b>"}, "blind": {}}
    plan = submission["run"]["plan"] | {"promptings": ["one-shot-cot"], "presentation": ["names"]}
    folder = written(tmp_path / "board", mine=changed(submission, agents=agents, plan=plan))
    assert main(["board", str(folder), "--title", "Ours & theirs"]) == 0
    page = (folder / "board.html").read_text(encoding="utf-8")
    assert "<h1>Ours &amp; theirs</h1>" in page
    assert '<td class="text">openai: &lt;b&gt;gpt&lt;/b&gt;</td>' in page
    assert '<td class="text">none stated</td>' in page
    assert page.count("one-shot-cot, native calls, presentation names</td>") == 2
    assert submission["seal"]["head"][:12] in page
    assert page.index(">reference</th>") < page.index(">blind</th>")
    assert "http" not in page.replace("http-equiv", "")


def test_only_agents_on_the_same_variants_and_rules_are_ranked_together(
    submission: dict[str, Any], tmp_path: Path
) -> None:
    other = changed(submission, plan=submission["run"]["plan"] | {"seeds": [1]})
    folder = written(tmp_path / "board", a=submission, b=submission, c=other)
    assert main(["board", str(folder), "--out", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("<table>") == 2
    ranks = [row.split("</td>")[0] for row in page.split("<tr><td>")[1:]]
    assert sorted(ranks) == ["1", "1", "1", "2", "3", "3"]  # equal agents share a rank


def test_a_folder_without_submissions_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["board", str(tmp_path)]) == 2
    assert "holds no submission" in capsys.readouterr().err
    (tmp_path / "x.json").write_text("{}", encoding="utf-8")
    assert main(["board", str(tmp_path)]) == 2
    assert "x.json is no submission" in capsys.readouterr().err


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")])
def test_the_page_fits_its_window(
    browser: Page, submission: dict[str, Any], tmp_path: Path, width: int, scheme: str
) -> None:
    folder = written(tmp_path / "board", a=submission, b=submission)
    assert main(["board", str(folder)]) == 0
    browser.look(width, scheme)
    browser.open(folder / "board.html")
    assert browser.run("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    assert browser.run(f"matchMedia('(prefers-color-scheme: {scheme})').matches")
    assert browser.run("document.querySelectorAll('tbody tr').length") == 4
    browser.picture(tmp_path / "picture.png")
