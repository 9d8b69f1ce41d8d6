"""Tests of untrusted films and frames: the report omits invalid files, and scripts in files do not run."""

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

import pytest

from evaluator.commands.program import main
from evaluator.errors import StoreError
from evaluator.records.episode import Episode, Frame
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.report.attachments import FILMS, FRAMES, PLAYER, attached, film_file
from evaluator.report.film_record import MOST_BYTES, Film, read, written
from evaluator.report.page import PAGES, write_report
from evaluator.store.run_folder import RunFolder
from tests.builders.chromium import Page
from tests.builders.films import attached_run, file_of, key_of, record_of, stored_run
from tests.builders.records import answer, call, episode, episode_key, returned, turn

TURNS = [[call("step", duration=0.1)], [call("answer", answer=7.848)]]
OTHER_TURNS = [[call("step", duration=0.2)], [call("step", duration=0.1)], [call("answer", answer=1)]]
KEY, OTHER = key_of(7, TURNS), key_of(7, OTHER_TURNS)
PNG = b"\x89PNG\r\n\x1a\n and the rest"
PWNED = "globalThis.pwned=1"


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    made = stored_run(tmp_path_factory.mktemp("filmed") / "run", (KEY, TURNS), (OTHER, OTHER_TURNS))
    assert main(["film", str(made.path)]) == 0
    return made


@pytest.fixture
def run(filmed: RunFolder, tmp_path: Path) -> RunFolder:
    """A run with two films, of which each test uses one."""
    return RunFolder(Path(shutil.copytree(filmed.path, tmp_path / "stranger")))


def put(text: str, instead: str) -> Callable[[str], str]:
    """Return a function that replaces the first occurrence of a text, which must be present."""

    def spoil(film: str) -> str:
        assert text in film
        return film.replace(text, instead, 1)

    return spoil


def again(pattern: str, instead: str) -> Callable[[str], str]:
    """Return a function that replaces the first match of a pattern, which must be present."""

    def spoil(film: str) -> str:
        spoiled, count = re.subn(pattern, instead, film, count=1)
        assert count == 1
        assert spoiled != film
        return spoiled

    return spoil


GROUP = r"\1"
COURSE = '{"kind":"rod","points":[[0,0,0],[1,0,0]]}'
FIRST = '{"format":1'
ATTACKS: dict[str, Callable[[str], str]] = {
    "another script": lambda _: f"{PWNED};\n",
    "a statement after the call": lambda film: f"{film}{PWNED};\n",
    "a statement in its last line": put(");\n", f");{PWNED};physmentFilm(0);\n"),
    "a statement before the call": lambda film: f"{PWNED};{film}",
    "a second argument": put("});", f"}},{PWNED});"),
    "a call in the record": put(FIRST, f'{{"format":({PWNED})'),
    "a comment": put(FIRST, '{/* */"format":1'),
    "a line comment": put(");\n", ");//);\n"),
    "a template": lambda _: f"physmentFilm(`${{{PWNED}}}`);\n",
    "a byte order mark": lambda film: f"\ufeff{film}",
    "the end of a script": put('"object_1"', '"</script><script>globalThis.pwned=1</script>"'),
    "a line separator": put('"object_1"', '"object_1\u2028"'),
    "an escaped line separator": put('"object_1"', '"object_1\\u2028"'),
    "a line feed in a name": put('"object_1"', '"object_1\\n"'),
    "a prototype": put(FIRST, '{"__proto__":{"pwned":1},"format":1'),
    "a body named as a prototype": lambda film: film.replace('"object_1"', '"__proto__"'),
    "a fixture named as a method": put(
        '"bodies":[', '"bodies":[{"id":"constructor","object":false,"movable":false,"parts":[]},'
    ),
    "an unknown field": put(FIRST, '{"src":"https://example.org","format":1'),
    "another version": put(FIRST, '{"format":2'),
    "an array": lambda film: film.replace("physmentFilm(", "physmentFilm([").replace(");", "]);"),
    "nothing": lambda _: "",
    "no end": lambda film: film.removesuffix(");\n"),
    "a number that is none": lambda film: re.sub(r'"count":\d+', '"count":NaN', film),
    "more instants than a browser has memory for": lambda film: re.sub(r'"count":\d+', '"count":3000000', film),
    "an endless step": lambda film: re.sub(r'"step":[^,]+', '"step":1e999', film),
    "a shape that is none": put('"shape":"sphere"', '"shape":"<img src=x onerror=alert(1)>"'),
    "a shape without a size": again(r'"size":\[[^]]*\]', '"size":[0,0,0]'),
    "a shape without an orientation": again(r'"quat":\[[^]]*\]', '"quat":[0,0,0,0]'),
    "a negative size": again(r'"size":\[[^]]*\]', '"size":[-1,-1,-1]'),
    "a size of no number": again(r'"size":\[[^]]*\]', '"size":[NaN,NaN,NaN]'),
    "a shape farther than the engine knows": again(r'"pos":\[[^]]*\]', '"pos":[1e300,0,0]'),
    "more shapes than can be drawn": again(r'"parts":\[(\{.*?\})\]', rf'"parts":[{",".join([GROUP] * 501)}]'),
    "calls that return before the ones before them": again(r'"calls":\[\[\d+\],\[\d+\]', '"calls":[[20],[3]'),
    "more courses than can be drawn": put('"bodies":[{', f'"schematic":[{",".join([COURSE] * 101)}],"bodies":[{{'),
    "a name of two lines": again(r'"names":\{[^}]*\}', r'"names":{"object_1":"a\\nb"}'),
    "a name without an end": again(r'"names":\{[^}]*\}', f'"names":{{"object_1":"{"a" * 101}"}}'),
    "a name of markup as an id": again(r'"names":\{[^}]*\}', '"names":{"<b>":"a"}'),
    "no base64": put('"data":"', '"data":"*'),
    "a deep record": lambda _: f"physmentFilm({'[' * 100_000});\n",
    "a hash of another record": lambda film: re.sub(r'"[0-9a-f]{64}"', f'"{"0" * 64}"', film),
    "no UTF-8": put("object_1", "\udcff"),
}


@pytest.mark.parametrize("attack", ATTACKS)
def test_what_is_not_exactly_a_film_is_left_out_and_the_other_film_stays(
    run: RunFolder, tmp_path: Path, attack: str
) -> None:
    file = file_of(run, KEY)
    text = ATTACKS[attack](file.read_text(encoding="utf-8"))
    file.write_bytes(text.encode("utf-8", errors="surrogateescape"))
    target = RunFolder(tmp_path / "out")
    target.path.mkdir()
    shown = attached_run(run, target.path)
    assert list(shown.attachments.films) == [OTHER]
    (sentence,) = shown.attachments.left_out
    assert sentence.startswith(f"1 file of {FILMS} is left out of the report, such as {file.name}: it ")
    assert not re.search(r"pwned|script|[^\x20-\x7e]", sentence)
    page = write_report(target, [shown]).read_text(encoding="utf-8")
    assert f'"{FILMS}/{file.name}"' not in page
    assert page.count('<div class="film"') == 1
    assert "Left out" in page
    assert [one.name for one in (target.path / FILMS).iterdir()] == [file_of(run, OTHER).name]


def test_a_spoiled_film_runs_nothing_in_the_report_of_its_own_folder(run: RunFolder, browser: Page) -> None:
    content = file_of(run, KEY).read_text(encoding="utf-8")
    file_of(run, KEY).write_text(f"{PWNED};{content}", encoding="utf-8")
    (run.path / PLAYER).write_text(f"{PWNED};", encoding="utf-8")
    (run.path / PAGES).mkdir()
    (run.path / PAGES / "1.js").write_text(f"{PWNED};", encoding="utf-8")
    page = write_report(run, [attached_run(run)])
    for number in (1, 2):
        browser.open(page, f"#episode-{number}")
        browser.run("document.querySelectorAll('.film > button').forEach((one) => one.click())")
    browser.wait("document.querySelector('.film-panel') !== null")
    assert browser.run("globalThis.pwned") is None


def test_a_film_is_written_anew(run: RunFolder, tmp_path: Path) -> None:
    file = file_of(run, KEY)
    content = file.read_bytes()
    file.write_bytes(content.replace(b'{"format":1,', b'{ "format":2,\n"format" : 1,'))
    assert list(attached_run(run, tmp_path).attachments.films) == [KEY, OTHER]
    assert film_file(tmp_path, record_of(run, KEY)).read_bytes() == content
    assert attached_run(run).attachments.left_out == ()
    assert file.read_bytes() == content, "also in its own folder"


def test_a_film_of_another_episode_is_left_out(run: RunFolder) -> None:
    shutil.copy(file_of(run, OTHER), file_of(run, KEY))
    found = attached_run(run).attachments
    assert list(found.films) == [OTHER]
    assert "it shows another record of its episode" in found.left_out[0]


def test_a_film_under_a_name_of_no_record_is_left_out_and_its_name_is_not_repeated(run: RunFolder) -> None:
    file_of(run, KEY).rename(run.path / FILMS / "\x1b[31m.js")
    found = attached_run(run).attachments
    assert list(found.films) == [OTHER]
    assert found.left_out[0].endswith(
        "such as a file with another name: its name is of no record of this run; physment-eval film makes films of its"
        " episodes"
    )


@pytest.mark.parametrize("kind", ["a link", "a folder", "a pipe", "huge"])
def test_what_is_no_regular_file_of_bounded_size_is_left_out(run: RunFolder, tmp_path: Path, kind: str) -> None:
    file = file_of(run, KEY)
    if kind == "a link":
        file.symlink_to(file.rename(tmp_path / "film.js"))
    elif kind == "huge":
        with file.open("r+b") as stream:
            stream.truncate(MOST_BYTES + 1)
    else:
        file.unlink()
        file.mkdir() if kind == "a folder" else os.mkfifo(file)
    found = attached_run(run, tmp_path).attachments
    assert list(found.films) == [OTHER]
    expected = {"a link": "it is a link", "huge": f"it has more than {MOST_BYTES} bytes"}
    assert expected.get(kind, "it is no regular file") in found.left_out[0]


@pytest.mark.parametrize("name", [FILMS, PAGES, FRAMES])
def test_a_report_writes_through_no_linked_folder(run: RunFolder, tmp_path: Path, name: str) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "1.js").write_text("mine", encoding="utf-8")
    with_frame(run)
    source = RunFolder(Path(shutil.copytree(run.path, tmp_path / "source")))
    shutil.rmtree(run.path / name, ignore_errors=True)
    (run.path / name).symlink_to(elsewhere)
    with pytest.raises(StoreError, match="is a link"):
        write_report(run, [attached_run(source, run.path)], inline=1)
    assert [one.name for one in elsewhere.iterdir()] == ["1.js"]
    assert (elsewhere / "1.js").read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("name", ["report.html", ".report.html.new", PLAYER, f"{PAGES}/1.js"])
def test_a_report_writes_through_no_linked_file(run: RunFolder, tmp_path: Path, name: str) -> None:
    mine = tmp_path / "mine"
    mine.write_text("mine", encoding="utf-8")
    (run.path / PAGES).mkdir()
    (run.path / name).symlink_to(mine)
    write_report(run, [attached_run(run)], inline=1)
    assert mine.read_text(encoding="utf-8") == "mine"
    assert not (run.path / name).is_symlink()


def with_frame(run: RunFolder, content: bytes = PNG) -> Frame:
    """Add an episode with a frame in the result of its first call."""
    frame = Frame.of(content)
    exchange = returned("step", duration=0.1).model_copy(update={"frames": (frame,)})
    run.append_episode(episode(turn("", exchange), key=episode_key(8), answer=1))
    return frame


def test_a_frame_is_linked_only_if_it_is_the_picture_that_the_record_names(run: RunFolder, tmp_path: Path) -> None:
    frame, other = with_frame(run), PNG + b" of another"
    (tmp_path / "out").mkdir()
    file = run.frames_folder / f"{frame.name}.png"
    assert attached_run(run, tmp_path).attachments.frames == {frame.name}
    assert (tmp_path / FRAMES / file.name).read_bytes() == PNG
    for content in (other, b"<svg onload=alert(1)>"):
        file.write_bytes(content)
        found = attached_run(run, tmp_path / "out").attachments
        assert found.frames == frozenset()
        assert found.left_out[0].endswith(f"such as {file.name}: it is not the picture that the record names")
    assert not (tmp_path / "out" / FRAMES).exists()
    file.unlink()
    assert "No such file" in attached_run(run).attachments.left_out[0]


@pytest.mark.parametrize("name", ["../../../secret", "/etc/passwd", "0" * 23, "0" * 24 + "\n", "javascript:alert(1)//"])
def test_a_frame_with_the_name_of_another_place_is_no_record(run: RunFolder, name: str) -> None:
    frame = with_frame(run)
    text = run.episodes_file.read_text(encoding="utf-8").replace(frame.name, name.replace("\n", "\\n"))
    run.episodes_file.write_text(text, encoding="utf-8")
    with pytest.raises(StoreError, match=r"is damaged: turns\.0\.exchanges\.0\.frames\.0\.name"):
        run.episodes()


def links(page: str) -> set[str]:
    """Return the addresses that a page loads or links, except anchors in itself."""
    found = re.findall(r'(?:href|src|data-film)="([^"#]*)"', page)
    return {unquote(address) for address in found if address and not address.startswith("data:")}


def test_a_report_of_two_runs_is_whole_when_its_folder_is_moved(run: RunFolder, tmp_path: Path, browser: Page) -> None:
    with_frame(run)
    again = stored_run(tmp_path / "again" / "run", (KEY, TURNS))
    assert main(["film", str(again.path)]) == 0
    assert record_of(again, KEY) != record_of(run, KEY), "two records of episodes with one key"
    for one in (run, again):
        assert main(["grade", str(one.path)]) == 0
    assert main(["report", str(run.path), str(again.path), "--out", str(tmp_path / "out")]) == 0
    moved = Path(shutil.move(tmp_path / "out", tmp_path / "sent"))
    shutil.rmtree(run.path)
    shutil.rmtree(again.path)
    found = links((moved / "report.html").read_text(encoding="utf-8"))
    assert len([address for address in found if address.startswith(f"{FILMS}/")]) == 3
    assert len([address for address in found if address.startswith(f"{FRAMES}/")]) == 1
    assert [address for address in found if not (moved / address).is_file() or ".." in address] == []
    assert (moved / PLAYER).is_file()
    browser.open(moved / "report.html", "#episode-1")
    browser.run("document.querySelector('#episode-1 .film > button').click()")
    browser.wait("document.querySelector('.film-panel') !== null")


def test_the_command_says_what_is_left_out(run: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    file_of(run, KEY).write_text(f"{PWNED};", encoding="utf-8")
    assert main(["grade", str(run.path)]) == 0
    capsys.readouterr()
    assert main(["report", str(run.path)]) == 0
    told = (
        f"{run.path}: 1 file of films is left out of the report, such as {file_of(run, KEY).name}: it is not one call"
    )
    assert told in capsys.readouterr().err


def test_a_film_that_is_read_and_written_is_the_same(filmed: RunFolder) -> None:
    script = file_of(filmed, KEY).read_bytes()
    film = read(script, record_of(filmed, KEY))
    assert isinstance(film, Film)
    assert written(film) == script
    assert attached(filmed, (), filmed.path).left_out == ()


def test_what_agents_write_is_text_in_every_page(tmp_path: Path, browser: Page) -> None:
    """Agents and third parties choose the texts of a record; every page must escape them."""
    evil = (
        f"</script><script>{PWNED}</script><img src=x onerror={PWNED}>\u2028\"'><div class=film data-film=x.js>"
        "<button>▶</button></div>{{ 7 * 7 }}`${1}`"
    )
    exchange = returned("step", {"sim_time": 0.1, evil: evil, "revealed": [{evil: evil}]}, object_id=evil)
    plan = Plan(scenes=(7,), agents=(evil,))
    stranger = RunFolder(tmp_path / "run")
    stranger.create(resume=False)
    stranger.write_run(RunRecord(created_at=evil, plan=plan, server=ServerRecord(option=evil)))
    said = turn(evil, exchange, returned("answer", answer=evil)).model_copy(update={"note": evil})
    for number in (1, 2):
        key = episode_key(7, seed=number, agent=evil)
        stranger.append_episode(episode(said, key=key, answer=evil, prompt=evil, error=evil))
    assert all(isinstance(one, Episode) for one in stranger.episodes().values())
    for inline in (300, 1):
        page = write_report(stranger, [attached_run(stranger)], inline)
        browser.open(page, "#episode-1")
        browser.wait("document.querySelector('#episode-1 .notebook') !== null")
        assert browser.run("globalThis.pwned") is None
        assert browser.run("document.querySelectorAll('.film, .notebook img, .notebook script').length") == 0
        assert "{{ 7 * 7 }}" in browser.run("document.querySelector('#episode-1').textContent")


def test_an_answer_is_shown_without_films(tmp_path: Path) -> None:
    run = stored_run(tmp_path / "run", (KEY, [[call("step", duration=0.1)], [answer(7.848)]]))
    assert attached_run(run).attachments == ({}, frozenset(), ())
    assert not (run.path / FILMS).exists()
