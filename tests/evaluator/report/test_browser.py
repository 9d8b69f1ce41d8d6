"""Tests of the report opened from disk in Chromium, with the mouse and with the keyboard alone."""

from pathlib import Path

import pytest

from evaluator.report.agent_results import Run
from evaluator.report.page import PAGES, write_report
from evaluator.store.run_folder import RunFolder
from tests.builders.chromium import Page

SECTIONS = (
    "overview",
    "ladder",
    "budgets",
    "categories",
    "dimensions",
    "failures",
    "spending",
    "episodes",
    "provenance",
)
SHOWN = "document.getElementById('shown').textContent"
LISTED = "document.querySelectorAll('#list > details').length"
FOCUSED = "document.activeElement.closest('details')?.id"


@pytest.fixture(scope="module", params=[300, 10], ids=["one file", "notebooks beside"])
def report(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory, study: Run) -> Path:
    """The report as one file, and as one with notebooks that are loaded when opened."""
    folder = tmp_path_factory.mktemp("report")
    file = write_report(RunFolder(folder), [study], inline=request.param)
    assert (folder / PAGES).is_dir() == (request.param == 10)
    return file


@pytest.fixture(autouse=True)
def no_complaints(browser: Page) -> object:
    browser.complaints.clear()
    yield
    assert browser.complaints == []


def choose(browser: Page, field: str, value: str) -> None:
    browser.run(
        f"(() => {{ const one = document.getElementById('{field}'); one.value = '{value}';"
        "one.dispatchEvent(new Event('input')); one.dispatchEvent(new Event('change')); })()"
    )


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_every_section_is_shown_and_the_page_fits_its_window(
    browser: Page, report: Path, width: int, scheme: str
) -> None:
    browser.look(width, scheme)
    browser.open(report)
    for name in SECTIONS:
        assert browser.run(f"document.getElementById('{name}').getBoundingClientRect().height > 0"), name
        assert browser.run(f"!!document.querySelector('nav a[href=\"#{name}\"]')"), name
    assert browser.run("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    assert browser.run("document.querySelectorAll('main figure.chart').length") >= 5
    paper = browser.run("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)[0]")
    assert (paper < 60) == (scheme == "dark")


def test_a_browser_without_scripts_lists_all_episodes(browser: Page, report: Path) -> None:
    browser.send("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(report)
        assert browser.run("document.getElementsByClassName('episode').length") == 64
        assert browser.run("document.querySelector('#list details summary').getBoundingClientRect().height > 0")
    finally:
        browser.send("Emulation.setScriptExecutionDisabled", value=False)


def test_filters_shorten_the_list_and_show_how_many_episodes_are_left(browser: Page, report: Path) -> None:
    browser.open(report)
    assert browser.run(SHOWN) == "64 of 64 episodes."
    assert browser.run(LISTED) == 50
    browser.run("document.getElementById('next').click()")
    assert browser.run(LISTED) == 14
    for field, value, left in [
        ("agent", "0", 32),
        ("verdict", "incorrect", 16),
        ("budget", "5", 8),
        ("mode", "answer_format_mismatch", 8),
        ("category", "hard-single", 4),
        ("outcome", "answered", 4),
        ("scene", "10", 1),
        ("find", "NO idea", 1),
        ("find", "nowhere", 0),
    ]:
        choose(browser, field, value)
        assert browser.run(SHOWN) == f"{left} of 64 episodes.", field
    browser.run("document.getElementById('clear').click()")
    assert browser.run(SHOWN) == "64 of 64 episodes."


def test_a_count_of_failures_links_to_its_episodes(browser: Page, report: Path) -> None:
    browser.open(report)
    assert browser.run("document.querySelector('a[data-filter*=answer_format]').textContent") == "16 of 32"
    browser.run("document.querySelector('a[data-filter*=answer_format]').click()")
    assert browser.run(SHOWN) == "16 of 64 episodes."
    assert browser.run("location.hash") == "#episodes?mode=answer_format_mismatch&agent=0"


def test_an_episode_opens_by_its_address_and_links_a_number_to_the_return_that_supports_it(
    browser: Page, report: Path
) -> None:
    browser.open(report, "#episode-61")
    browser.wait("document.querySelector('#episode-61[open] .notebook') !== null")
    assert browser.run("document.querySelectorAll('#episode-61 .notebook figure.chart').length") == 1
    assert browser.run("document.querySelector('#episode-61 .baseless').textContent") == "55.3 kg"
    browser.run("document.querySelector('#episode-61 a.grounded').click()")
    browser.wait("document.activeElement.id === 'episode-61-1-2'")
    assert "1.951" in browser.run("document.activeElement.textContent")
    assert browser.run("document.querySelectorAll('#episode-61 .notebook').length") == 1


def test_the_keyboard_alone_reaches_and_opens_an_episode(browser: Page, report: Path) -> None:
    browser.look(1280, "light")
    browser.open(report)
    browser.press("Tab")
    assert browser.run("document.activeElement.className") == "skip"
    browser.press("Enter")
    browser.wait("document.activeElement.id === 'overview'")
    browser.run("document.getElementById('close').focus()")
    browser.press("Tab")
    assert browser.run(FOCUSED) == "episode-1"
    assert browser.run("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    for key, reached in [("ArrowDown", 2), ("ArrowDown", 3), ("ArrowUp", 2), ("End", 50), ("Home", 1)]:
        browser.press(key)
        assert browser.run(FOCUSED) == f"episode-{reached}"
    browser.press("Enter")
    browser.wait("document.querySelector('#episode-1[open] .notebook') !== null")


def test_everything_that_can_be_clicked_can_be_reached_by_keyboard(browser: Page, report: Path) -> None:
    browser.open(report)
    assert browser.run(
        "[...document.querySelectorAll('a, button, select, input, summary')].every(n => n.tabIndex >= 0"
        " || n.closest('.verdicts ul').querySelector('a:not([tabindex])') !== null)"
    )
    unnamed = "n => !(n.labels?.length || n.getAttribute('aria-label') || n.textContent.trim())"
    assert browser.run(f"[...document.querySelectorAll('a, button, select, input')].filter({unnamed}).length") == 0


def test_a_cell_of_the_grid_leads_to_the_episodes_of_its_agent_in_its_scene(browser: Page, report: Path) -> None:
    browser.look(1280, "light")
    browser.open(report)
    cells = "[...document.querySelectorAll('.verdicts ul')].map(row => [...row.querySelectorAll('a')])"
    assert browser.run(f"{cells}.map(row => row.length)") == [16, 16]
    assert browser.run(f"{cells}.map(row => row.filter(cell => cell.tabIndex === 0).length)") == [1, 1]
    browser.run(f"{cells}[0][0].focus()")
    key = "document.activeElement.dispatchEvent(new KeyboardEvent('keydown', {{ key: '{}', bubbles: true }}))"
    for pressed in ("ArrowRight", "ArrowRight", "ArrowDown", "ArrowLeft"):
        browser.run(key.format(pressed))
    assert browser.run(f"{cells}[1].indexOf(document.activeElement)") == 1
    words = browser.run("document.activeElement.getAttribute('aria-label')")
    assert browser.run("document.getElementById('pointed').textContent") == words
    assert words.startswith("8")
    assert words.endswith("2 of 2 correct")
    assert browser.run(f"{cells}[0][0].textContent + {cells}[1][1].textContent") == "±✓"
    browser.run("document.activeElement.click()")
    browser.wait(f"{SHOWN} === '2 of 64 episodes.'")
    assert browser.run("location.hash") == "#episodes?scene=8&agent=1"


def test_what_is_filtered_stands_in_the_address_and_comes_from_there(browser: Page, report: Path) -> None:
    browser.open(report, "#episodes?verdict=incorrect&find=scene+8")
    assert browser.run(SHOWN) == "2 of 64 episodes.", "of scenes 8 and 18"
    assert browser.run("document.activeElement.id") == "episodes"
    choose(browser, "verdict", "correct")
    assert browser.run("location.hash") == "#episodes?verdict=correct&find=scene+8"
    browser.run("document.getElementById('clear').click()")
    assert browser.run("location.hash") == "#episodes"
    assert browser.run(SHOWN) == "64 of 64 episodes."


def test_a_table_is_sorted_by_the_column_whose_title_is_pressed(browser: Page, report: Path) -> None:
    browser.open(report)
    table = "document.querySelector('main .wide > table')"
    names = f"[...{table}.tBodies[0].rows].map(row => row.cells[0].textContent.split(' ')[0].trim())"
    press = f"{table}.tHead.rows[0].cells[{{}}].querySelector('button').click()"
    browser.run(press.format(1))
    assert browser.run(names) == ["reference", "model:x"], "the largest first"
    browser.run(press.format(1))
    assert browser.run(names) == ["model:x", "reference"]
    assert browser.run(f"{table}.tHead.rows[0].cells[1].getAttribute('aria-sort')") == "ascending"
    assert browser.run(f"{table}.tHead.querySelectorAll('[aria-sort]').length") == 1


def test_text_has_enough_contrast_in_light_and_dark(browser: Page, report: Path) -> None:
    """WCAG 2.2, 1.4.3: a contrast of at least 4.5, also on every tint of the heat map."""
    for scheme in ("light", "dark"):
        browser.look(1280, scheme)
        browser.open(report)
        weak = browser.run(CONTRAST)
        assert weak == [], scheme


CONTRAST = """(() => {
  const canvas = new OffscreenCanvas(1, 1).getContext('2d', { willReadFrequently: true });
  const rgb = (colours) => {
    for (const one of colours) { canvas.fillStyle = one; canvas.fillRect(0, 0, 1, 1); }
    return [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3);
  };
  const light = (c) => c.map((v) => v / 255).map((v) => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const weak = new Set();
  for (const node of document.querySelectorAll('main *, footer *, header *')) {
    if (![...node.childNodes].some((n) => n.nodeType === 3 && n.data.trim()) || !node.checkVisibility()) continue;
    const grounds = [];
    for (let n = node; n; n = n.parentElement) grounds.unshift(getComputedStyle(n).backgroundColor);
    const style = getComputedStyle(node);
    const [a, b] = [light(rgb(grounds)), light(rgb([...grounds, node.closest('svg') ? style.fill : style.color]))];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (contrast < 4.5 && !node.disabled) weak.add(`${node.tagName} ${node.textContent.slice(0, 30)} ${contrast}`);
  }
  return [...weak].slice(0, 10);
})()"""


def test_a_missing_notebook_is_reported_where_it_would_be(browser: Page, tmp_path: Path, study: Run) -> None:
    file = write_report(RunFolder(tmp_path), [study], inline=10)
    (tmp_path / PAGES / "3.js").unlink()
    browser.open(file, "#episode-3")
    browser.wait("document.querySelector('#episode-3 .notebook') !== null")
    assert "report_episodes/3.js" in browser.run("document.querySelector('#episode-3').textContent")
    browser.complaints.clear()  # the browser itself reports the missing file


def test_the_printed_page_lists_the_episodes_and_has_no_controls(browser: Page, report: Path) -> None:
    browser.open(report)
    browser.send("Emulation.setEmulatedMedia", media="print")
    visible = "n => n.checkVisibility()"
    assert not browser.run(f"[...document.querySelectorAll('nav, .filter, .skip')].some({visible})")
    assert browser.run(f"[...document.querySelectorAll('#list > details')].filter({visible}).length") == 50
    browser.send("Emulation.setEmulatedMedia", media="")


def test_without_scripts_all_episodes_can_be_read(browser: Page, tmp_path: Path, study: Run) -> None:
    file = write_report(RunFolder(tmp_path), [study])
    browser.send("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(file)
        assert browser.run("document.querySelectorAll('#list > details .notebook').length") == 64
        assert not browser.run("document.getElementById('find').checkVisibility()")
    finally:
        browser.send("Emulation.setScriptExecutionDisabled", value=False)
