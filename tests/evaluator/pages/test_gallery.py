"""Tests of the gallery that `scenes list --html` writes."""

import base64
import re
import shutil
from collections.abc import Generator
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.pages.pictures import Card, gallery
from scenes import default_folder
from tests.builders.chromium import Page, chromium, installed

PNG = b"\x89PNG\r\n\x1a\n"


def test_the_page_has_a_card_for_each_scene_with_its_picture_and_a_link_to_its_page(tmp_path: Path) -> None:
    for scene in (7, 101):
        shutil.copytree(default_folder() / f"Scene{scene}", tmp_path / "scenes" / f"Scene{scene}")
    small = tmp_path / "docs" / "reference" / "scenes" / "small"
    small.mkdir(parents=True)
    (small / "scene7.png").write_bytes(PNG)
    (small.parent / "scene7.md").write_text("task", "utf-8")
    out = tmp_path / "out" / "scenes.html"
    out.parent.mkdir()
    assert main(["scenes", "list", "--scenes-dir", str(tmp_path / "scenes"), "--html", str(out)]) == 0
    text = out.read_text("utf-8")
    assert text.count("<li ") == 2
    assert base64.b64encode(PNG).decode() in text
    assert text.count("no picture") == 1
    assert '<a href="../docs/reference/scenes/scene7.md">7. Speed of a dropped ball</a>' in text
    assert re.findall(r'data-rung="(\w+)" data-category="([a-z-]+)"', text) == [
        ("easy", "easy-single"),
        ("hard", "create-delete-attach"),
    ]
    assert not re.findall(r'(?:src|href)="(?!data:|\.\./docs)', text)


def test_a_link_without_a_page_and_a_page_that_cannot_be_written_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenes", "list", "--scenes", "7", "--link", "https://example.org/scenes"]) == 2
    assert "--link belongs to --html" in capsys.readouterr().err
    html = str(tmp_path / "scenes.html")
    assert main(["scenes", "list", "--scenes", "7", "--html", html, "--link", "https://example.org/scenes"]) == 2
    assert "--link holds {scene}" in capsys.readouterr().err
    address = "https://example.org/scene{scene}.html"
    assert main(["scenes", "list", "--scenes", "7", "--html", html, "--link", address]) == 0
    assert 'href="https://example.org/scene7.html"' in Path(html).read_text("utf-8")
    assert re.search(r"<br>difficulty −[\d.]+ ± [\d.]+, far easier</p>", Path(html).read_text("utf-8"))
    assert main(["scenes", "list", "--scenes", "7", "--html", str(tmp_path / "none" / "x.html")]) == 2
    assert "cannot be written" in capsys.readouterr().err


@pytest.fixture
def browser(tmp_path: Path) -> Generator[Page]:
    program = installed()
    if program is None:
        pytest.skip("no Chromium is installed, so the page is not opened in a browser")
    with chromium(program, tmp_path / "profile") as page:
        yield page


def test_filters_hide_the_other_cards(browser: Page, tmp_path: Path) -> None:
    cards = [
        Card(k, f"<b>{k}</b>", *kind, "") for k, kind in enumerate((("easy", "easy-single"), ("hard", "hard-single")))
    ]
    (tmp_path / "page.html").write_text(gallery(cards, ""), "utf-8")
    browser.open(tmp_path / "page.html")
    shown = "[...document.querySelectorAll('.cards li')].filter((one) => one.offsetParent).map((one) => one.innerText)"
    assert len(browser.run(shown)) == 2
    browser.run("rung.value = 'hard', rung.dispatchEvent(new Event('change', {bubbles: true}))")
    (left,) = browser.run(shown)
    assert "1. <b>1</b>" in left
    assert browser.run("count.textContent") == "1 of 2 scenes"
    browser.send("Emulation.setDeviceMetricsOverride", width=390, height=800, deviceScaleFactor=1, mobile=True)
    assert browser.run("document.documentElement.scrollWidth <= 390")
    assert browser.complaints == []
