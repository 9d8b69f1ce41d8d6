"""Tests of films in a report opened from disk: playback, keyboard, no requests, and messages if they cannot play."""

from collections.abc import Iterator
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from evaluator.commands.program import main
from evaluator.records.episode import ToolCall
from evaluator.report.agent_results import Run
from evaluator.report.attachments import FILMS, PLAYER
from evaluator.report.page import PAGES, render, write_report
from evaluator.store.run_folder import RunFolder
from tests.builders.chromium import SOFTWARE_WEBGL, Page, chromium, installed
from tests.builders.films import attached_run, file_of, key_of, stored_run
from tests.builders.records import RIGHT, call
from tests.builders.scored import scored

PROGRAM = installed()
FALL = [[call("step", duration=0.05), call("get_position", object_id="object_1")] for _ in range(19)]
TURNS = [*FALL, [call("answer", answer=7.848)]]
KEY = key_of(7, TURNS)
OTHER = key_of(7, [[call("step", duration=0.1)], [call("answer", answer=1)]])
CLOCK = "document.querySelector('.film-clock')?.textContent"
BUTTON = "document.querySelector('#episode-{} .film > button')"
LABELS = """(() => {
  const inside = (box) => [box.left, box.top, box.right, box.bottom];
  const labels = [...document.querySelectorAll('.film-box :is(.lab-label, .lab-scale, .lab-grid):not([hidden])')];
  return [document.querySelector('.film-box'), ...labels].map((shown) => inside(shown.getBoundingClientRect()));
})()"""
"""Left, upper, right and lower edges [px]: first of the picture, then of each label, those of the scale included."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    made = stored_run(
        tmp_path_factory.mktemp("filmed") / "run",
        (OTHER, [[call("step", duration=0.1)], [call("answer", answer=1)]]),
        (KEY, TURNS),
    )
    assert main(["film", str(made.path)]) == 0
    return made


def report(run: RunFolder, inline: int = 300) -> Path:
    return write_report(run, [attached_run(run)], inline)


@pytest.fixture(params=[(300, SOFTWARE_WEBGL), (1, ("--disable-3d-apis",))], ids=["webgl", "outline, notebooks beside"])
def shown(request: pytest.FixtureRequest, run: RunFolder, tmp_path: Path) -> Iterator[tuple[Page, Path]]:
    """A browser with a report, once with and once without WebGL."""
    if PROGRAM is None:
        pytest.skip("no Chromium is installed, so no film is played")
    inline, flags = request.param
    with chromium(PROGRAM, tmp_path / "profile", *flags) as page:
        page.send("Network.enable")
        page.look(1280, "light")
        yield page, report(run, inline)


def opened(browser: Page, page: Path, number: int) -> None:
    """Open an episode and its film."""
    browser.complaints.clear()
    browser.requests.clear()
    browser.open(page, f"#episode-{number}")
    browser.wait(f"{BUTTON.format(number)} !== null")
    browser.run(f"{BUTTON.format(number)}.click()")
    browser.wait("document.querySelector('.film-panel, .film-said') !== null")


def red(browser: Page, file: Path) -> int:
    """Count the pixels that are as red as the ball."""
    browser.picture(file, whole=False)
    colours = np.asarray(Image.open(file).convert("RGB"), dtype=np.int16)
    return int((colours[..., 0] - colours[..., 1:].max(axis=2) > 60).sum())


def test_a_film_plays_from_disk_and_asks_nobody(shown: tuple[Page, Path], run: RunFolder, tmp_path: Path) -> None:
    browser, page = shown
    opened(browser, page, 2)
    browser.wait(f"parseFloat({CLOCK}) > 0.3")
    browser.run("document.querySelector('.film-play').click()")
    assert "iteration" in browser.run(CLOCK)
    browser.run("document.querySelector('.film-box').scrollIntoView({ block: 'center' })")
    assert any(red(browser, tmp_path / "shot.png") > 40 for _ in range(40)), "the ball is drawn"
    outline = "draws no three-dimensional pictures" in browser.run("document.querySelector('.film-panel').textContent")
    assert outline == (browser.run("document.querySelector('.film-box canvas') === null"))
    assert [one for one in browser.complaints if "GPU stall" not in one] == []
    folder = page.parent.resolve().as_uri()
    expected = {f"{folder}/report.html", f"{folder}/{PLAYER}", f"{folder}/{FILMS}/{file_of(run, KEY).name}"}
    beside = {f"{folder}/{PAGES}/2.js"} if (page.parent / PAGES).is_dir() else set[str]()
    assert {address.split("#")[0] for address in browser.requests} == expected | beside


def test_calls_turns_and_times_follow_the_keyboard_and_the_charts_follow_the_film(
    run: RunFolder, browser: Page
) -> None:
    browser.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
    opened(browser, report(run), 2)
    assert browser.run(CLOCK) == "0.00 of 0.95 s, before the first call", "nothing moves by itself"

    def pressed(key: str) -> str:
        event = f"new KeyboardEvent('keydown', {{ key: '{key}', bubbles: true }})"
        browser.run(f"document.querySelector('.film-box').dispatchEvent({event})")
        return browser.run(CLOCK)

    assert pressed(".") == "0.05 of 0.95 s, iteration 1 of 20, call 1"
    assert pressed("]") == "0.10 of 0.95 s, iteration 2 of 20, call 1"
    assert pressed(".") == "0.10 of 0.95 s, iteration 2 of 20, call 2"
    assert "get_position" in browser.run("document.querySelector('.film-calls [aria-current]').textContent")
    assert pressed("[") == "0.05 of 0.95 s, iteration 1 of 20, call 1"
    scrubber = "document.querySelector('.film-controls input')"
    browser.run(f"{scrubber}.value = 0.5; {scrubber}.dispatchEvent(new Event('input'))")
    assert browser.run(CLOCK).startswith("0.50 of 0.95 s, iteration 10 of 20")
    ticks = (
        "[...document.querySelectorAll('#episode-2 .chart text.x')].map((t) => [+t.textContent, +t.getAttribute('x')])"
    )
    labels = browser.run(ticks)
    at = next(x for time, x in labels if time == 0.5) if any(time == 0.5 for time, _ in labels) else None
    (first, begin), (last, end) = labels[0], labels[-1]
    expected = at if at is not None else begin + (0.5 - first) / (last - first) * (end - begin)
    assert float(browser.run("document.querySelector('.film-cursor').getAttribute('x1')")) == pytest.approx(
        expected, abs=0.2
    )
    pressed("Escape")
    assert browser.run("document.querySelector('.film-panel, .film-cursor')") is None
    assert browser.run("document.activeElement === document.querySelector('#episode-2 .film > button')")
    browser.send("Emulation.setEmulatedMedia", features=[])


def test_labels_of_many_objects_cover_neither_each_other_nor_leave_the_picture(browser: Page, tmp_path: Path) -> None:
    def ball(number: int) -> ToolCall:
        place = [0.5 + 0.04 * (number % 3), 0.05 * (-1) ** number * (number // 2), 30 + 0.04 * (number % 2)]
        return call("create_objects", name=f"ball_{number}", pos=place, density=1000, rgba=[0, 0, 1, 1], radius=0.02)

    turns = [[ball(number) for number in range(18)], [call("answer", answer=7.848)]]
    made = stored_run(tmp_path / "crowded", (key_of(7, turns), turns))
    assert main(["film", str(made.path)]) == 0
    opened(browser, report(made), 1)
    scrubber = "document.querySelector('.film-controls input')"
    browser.run(f"{scrubber}.value = {scrubber}.max; {scrubber}.dispatchEvent(new Event('input'))")
    # A label that was not drawn yet is in the corner.
    browser.wait(f"{LABELS}.length > 4 && {LABELS}.every((box, place) => !place || box[1] > {LABELS}[0][1])")
    browser.run("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    picture, *labels = browser.run(LABELS)
    for left, top, right, bottom in labels:
        assert min(left - picture[0], top - picture[1], picture[2] - right, picture[3] - bottom) > -1
    for one, other in combinations(labels, 2):
        widths = min(one[2], other[2]) - max(one[0], other[0])
        heights = min(one[3], other[3]) - max(one[1], other[1])
        assert min(widths, heights) < 1, "two labels overlap"


def test_a_call_of_the_notebook_is_shown_in_the_film_and_the_film_leads_back_to_it(
    run: RunFolder, browser: Page
) -> None:
    opened(browser, report(run), 2)
    go = "document.querySelector('#episode-2-{} button.film-go')"
    browser.run(f"{go.format('12-2')}.focus()")
    browser.press("Enter")
    assert browser.run(CLOCK) == "0.60 of 0.95 s, iteration 12 of 20, call 2"
    assert browser.run("document.activeElement.className") == "film-play"
    browser.run("document.querySelector('.film-calls tbody:first-of-type button.film-go').click()")
    assert browser.run(CLOCK) == "0.60 of 0.95 s, iteration 12 of 20, call 1"
    browser.run("document.querySelector('.film-head a').click()")
    browser.wait("document.activeElement.id === 'episode-2-12-1'")
    ticks = browser.run("document.querySelector('.film-track path').getAttribute('d')").split("M")[1:]
    assert (len(ticks), len([tick for tick in ticks if tick.endswith("V8")])) == (19, 19), "two calls share each tick"
    browser.run("document.querySelector('.film-panel button[aria-label=\"close the film\"]').click()")
    assert browser.run("document.querySelector('button.film-go')") is None


def test_a_film_of_another_record_a_missing_film_and_a_damaged_one_are_told_in_a_sentence(
    run: RunFolder, browser: Page
) -> None:
    page, file = report(run), file_of(run, KEY)
    content = file.read_text(encoding="utf-8")
    said = "document.querySelector('.film-said').textContent"
    try:
        for spoiled, sentence in [
            (content.replace('"episode":"', '"episode":"0'), "shows another record of this episode"),
            (content.replace('"format":1', '"format":2'), "made by another version"),
            (content.replace('"count":', '"count":9'), "is damaged (the film ends too early)"),
        ]:
            file.write_text(spoiled, encoding="utf-8")
            opened(browser, page, 2)
            assert sentence in browser.run(said)
            assert browser.run("document.querySelector('.film-panel')") is None
        file.unlink()
        opened(browser, page, 2)
        assert f"The film is missing: {FILMS}/{file.name}" in browser.run(said)
    finally:
        file.write_text(content, encoding="utf-8")


def test_a_report_without_films_has_no_player_and_no_button(run: RunFolder) -> None:
    rows = [scored(episode, RIGHT) for episode in run.episodes().values()]
    text = render([Run("run", run.read_run(), rows, {})]).page
    assert '<div class="film"' not in text
    assert "strict-dynamic" not in text
