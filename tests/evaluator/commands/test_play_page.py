"""Tests of `play --web`: the command and its page over HTTP, and the page in headless Chromium."""

import contextlib
import re
import signal
import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from evaluator.records.episode import Episode, Outcome
from evaluator.store.run_folder import RunFolder
from tests.builders.chromium import SOFTWARE_WEBGL, Page, chromium, installed

PROGRAM = installed()
STEP = {"tool": "step", "arguments": {"duration": 0.8}}
LOOK = {"tool": "get_velocity", "arguments": {"object_id": "object_1"}}


class Played:
    """A running `play --web` command, and an HTTP client that acts as its page."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        assert process.stdout is not None
        self.process = process
        self.line = process.stdout.readline()
        (self.address,) = re.findall(r"http://127\.0\.0\.1:\d+/[\w-]+/", self.line)
        self.http = self.window("one")

    def window(self, name: str) -> httpx.Client:
        return httpx.Client(base_url=self.address, headers={"x-physment-page": name}, timeout=300, trust_env=False)

    def state(self, **holds: Any) -> dict[str, Any]:
        """Poll the state as the page does, and return the first one that meets a condition."""
        version = -1
        while True:
            state = self.http.get("state", params={"after": version}).json()
            if all(state[name] == value for name, value in holds.items()):
                return state
            version = state["version"]

    def turn(self, *calls: dict[str, Any], note: str = "") -> None:
        self.state(waiting=True)
        done = self.http.post("turn", json={"calls": list(calls), "note": note})
        assert done.status_code == 204, done.text

    def end(self) -> str:
        """Close the page, and return the output of the command until it ends."""
        with contextlib.suppress(httpx.HTTPError):
            self.http.post("close")
        out, _ = self.process.communicate(timeout=300)
        return out


@contextmanager
def playing(cwd: Path, server: str, *words: str, scene: int = 7) -> Generator[Played]:
    command = [
        sys.executable,
        "-m",
        "evaluator",
        "play",
        f"{scene}",
        "--web",
        "--no-open",
        "--out",
        "run",
        "--server",
        server,
    ]
    with subprocess.Popen(
        [*command, *words], cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as run:
        played = Played(run)
        try:
            yield played
        finally:
            played.http.close()
            run.kill()


def episode_in(cwd: Path) -> Episode:
    (episode,) = RunFolder(cwd / "run").episodes().values()
    return episode


def test_a_scene_is_solved_over_http_recorded_and_graded_like_any_other(tmp_path: Path, host_url: str) -> None:
    with playing(tmp_path, host_url) as played:
        first = played.state(waiting=True)
        assert "# Scene: Speed of a dropped ball" in first["prompt"]
        assert (first["left"], len(first["tools"])) == (20, 26)
        assert first["view"]["drawing"]["bodies"][0]["id"] == "object_1"
        played.turn({"tool": "step", "arguments": {"duration": 0.3}}, LOOK, note="it falls")
        played.state(waiting=True, left=19)
        played.turn(
            {"tool": "step", "arguments": {"duration": 0.2}},
            {"tool": "step", "arguments": {"duration": 0.3}},
            LOOK,
            {"tool": "get_position", "arguments": {"object_id": 1}},
        )
        second = played.state(waiting=True, left=18)
        assert second["turns"][1]["exchanges"][2]["content"]["velocity"] == [0, 0, -7.848]
        place = second["turns"][1]["exchanges"][3]["content"]["position"]
        assert (first["read"], second["read"]) == ({}, {"object_1": {"position": place, "time": 0.8}})
        # The steps of one turn are played as one continuous motion.
        motion = second["view"]["motion"]
        assert (motion["times"][0], motion["times"][-1]) == (0.3, 0.8)
        assert motion["times"] == sorted(set(motion["times"]))
        assert len(motion["poses"]["object_1"]) == len(motion["times"]) == 101
        played.turn({"tool": "answer", "arguments": {"answer": 7.848}})
        version = -1
        while (last := played.http.get("state", params={"after": version}).json())["ended"] is None:
            version = last["version"]
        assert last["ended"] == "Correct, in 3 of 20 iterations."
        assert last["end"] == {
            "correct": True,
            "key": 7.848,
            "answer": 7.848,
            "choices": {"seed": "seed 1", "scene": "scene 8, Two balls on one slope"},
            "report": True,
        }
        assert "Speed of a dropped ball" in played.http.get("report").text
        assert "Correct, in 3 of 20 iterations." in played.end()
    episode = episode_in(tmp_path)
    assert (episode.key.agent, episode.answer, episode.turns[0].reasoning) == ("human", 7.848, "it falls")
    # Views that the page displayed are not recorded.
    assert "physment/view" not in (tmp_path / "run" / "episodes.jsonl").read_text(encoding="utf-8")
    assert (tmp_path / "run" / "report.html").is_file()


def test_what_is_wrong_is_refused_in_a_sentence_and_costs_nothing(tmp_path: Path, host_url: str) -> None:
    with playing(tmp_path, host_url) as played:
        played.state(waiting=True)
        wrong = [
            ({"calls": [{"tool": "fly", "arguments": {}}]}, "there is no tool 'fly'"),
            ({"calls": [{"tool": "step", "arguments": {"duration": "x"}}]}, "step: duration"),
            (
                {"calls": [{"tool": "answer", "arguments": {"answer": "7,848"}}]},
                "answer: 7,848 can be read in several ways and is not sent; write 7.848 or 7848 or [7, 848]",
            ),
            ({"calls": []}, "an iteration has 1 to 50 calls"),
            ({"call": 1}, "no iteration: "),
        ]
        for body, said in wrong:
            reply = played.http.post("turn", json=body)
            assert reply.status_code == 400
            assert said in reply.json()["error"]
        assert played.http.post("turn", content=b" " * 200_000).status_code == 413
        elsewhere = played.address.rsplit("/", 2)[0]
        assert httpx.get(f"{elsewhere}/wrong-token/", trust_env=False).status_code == 404
        named = httpx.get(played.address, headers={"host": "example.org"}, trust_env=False)
        assert (named.status_code, named.json()["error"]) == (403, "this page is for this machine alone")
        assert played.http.get("report").status_code == 404
        assert played.http.post("next", params={"play": "seed"}).status_code == 409
        assert played.state(waiting=True)["left"] == 20
        assert played.http.post("leave").status_code == 204
        assert played.state(ended="Nothing was done, and nothing is saved.")["end"]["key"] is None
        assert "nothing is saved" in played.end()
    assert list(tmp_path.iterdir()) == []


def test_another_window_is_refused_until_it_takes_over(tmp_path: Path, host_url: str) -> None:
    with playing(tmp_path, host_url) as played, played.window("two") as second:
        version = played.state(waiting=True)["version"]
        assert "another window" in second.get("state").json()["error"]
        assert "another window" in second.post("turn", json={"calls": [STEP]}).json()["error"]
        assert second.post("take-over").status_code == 204
        # The pending request of the first window is answered with the notice that another window took over.
        assert played.http.get("state", params={"after": version}).status_code == 409
        assert played.http.post("turn", json={"calls": [STEP]}).status_code == 409
        assert second.post("turn", json={"calls": [STEP]}).status_code == 204
        assert second.post("close").status_code == 204
        assert "in 1 of 20 iterations" in played.end()


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_a_page_whose_episode_is_open_elsewhere_shows_no_laboratory_until_it_takes_over(
    tmp_path: Path, host_url: str
) -> None:
    assert PROGRAM
    visible = "document.querySelector('main').checkVisibility()"
    with playing(tmp_path, host_url) as played, chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page:
        played.state(waiting=True)
        page.visit(played.address)
        page.wait("document.getElementById('elsewhere').checkVisibility()")
        assert not page.run(visible)
        page.run("document.getElementById('take').click()")
        page.wait(f"document.getElementById('run')?.disabled === false && {visible}")
        assert not page.run("document.getElementById('elsewhere').checkVisibility()")


def test_nothing_of_the_key_is_sent_before_the_answer_and_another_seed_follows(tmp_path: Path, host_url: str) -> None:
    with playing(tmp_path, host_url) as played:
        first = played.state(waiting=True)
        assert (first["end"], first["rules"]) == (None, {"limits": {}, "steps": []})
        played.turn({"tool": "answer", "arguments": {"answer": 1}})
        over = played.state(waiting=False)
        while over["end"] is None:
            over = played.http.get("state", params={"after": over["version"]}).json()
        assert (over["end"]["correct"], over["end"]["key"]) == (False, 7.848)
        assert played.http.post("next", params={"play": "seed"}).status_code == 204
        second = played.state(waiting=True, number=2)
        assert (second["ended"], second["end"], second["turns"], second["left"]) == (None, None, [], 20)
        played.turn(STEP, LOOK)
        played.state(waiting=True, left=19)
        assert "in 1 of 20 iterations: no answer" in played.end()
    episode = episode_in(tmp_path)
    (following,) = RunFolder(tmp_path / "run-2").episodes().values()
    assert (episode.key.seed, following.key.seed, following.key.scene) == (0, 1, 7)


def test_ctrl_c_leaves_and_a_taken_port_is_one_sentence(tmp_path: Path, host_url: str) -> None:
    with playing(tmp_path, host_url) as played:
        port = played.address.split(":")[2].split("/")[0]
        again = [sys.executable, "-m", "evaluator", "play", "7", "--web", "--no-open", "--port", port]
        refused = subprocess.run(again, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
        assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
        assert f"cannot listen on 127.0.0.1 port {port}" in refused.stderr
        played.turn(STEP)
        played.state(waiting=True, left=19)
        played.process.send_signal(signal.SIGINT)
        assert "Not correct, in 1 of 20 iterations: no answer" in played.end()
        assert played.process.returncode == 0
    episode = episode_in(tmp_path)
    assert (episode.outcome, episode.error) == (Outcome.AGENT_ERROR, "the person left without an answer")
    assert len(episode.turns) == 1


FILL = "(name, value) => { document.querySelector(`[name='${name}']`).value = value; }"
CHOOSE = "(name, value) => document.querySelector(`[name='${name}'][value='${value}']`).click()"
READ = "position [0, 0, 26.8608] m at 0.8 svelocity [0, 0, -7.848] m/s at 0.8 s"


def experiment_with(page: Page) -> None:
    for typed, sentence in (
        ("soon", "duration: soon is not a number"),
        ("1,500", "duration: 1,500 can be read in two ways; write 1.500 or 1500"),
        ("100", "duration: 100 is more than 60"),
    ):
        page.run(f"({FILL})('duration', '{typed}')")
        page.run("document.getElementById('run').click()")
        assert page.run("document.getElementById('said').textContent") == sentence
    # One click steps and reads; *Repeat last* repeats both with one more click.
    page.run(f"({FILL})('duration', '0,4')")
    assert page.run("document.getElementById('run').textContent") == "Step and read 3 calls, 1 iteration"
    page.run("document.getElementById('run').click()")
    page.wait("document.getElementById('budget').textContent === '19 of 20 iterations left'")
    page.run("document.getElementById('again').click()")
    page.wait("document.getElementById('budget').textContent === '18 of 20 iterations left'")
    assert "velocity [0, 0, -7.848] m/s" in page.run("document.getElementById('last').textContent")
    captions = page.run("[...document.querySelectorAll('figcaption')].map((one) => one.textContent)")
    assert captions == ["ball velocity [m/s]", "ball position [m]"]
    # Components that are left empty are 0.
    page.run(f"({CHOOSE})('group', 'Act')")
    page.run(f"({CHOOSE})('tool', 'set_velocity')")
    page.run("document.getElementById('add').click()")
    page.run(f"({CHOOSE})('group', 'Build')")
    page.run(f"({CHOOSE})('tool', 'delete_objects')")
    assert "give a velocity · ball · [0, 0, 0] m/s set_velocity" in page.run(
        "document.querySelector('.bench-queue').textContent"
    )
    page.run("document.querySelector('.bench-queue button').click()")


def reached_by_tab(page: Page) -> set[str]:
    """Return the elements that the Tab key reaches, each by its id, or else its name, or else its class."""
    reached: set[str] = set()
    page.run("document.activeElement.blur()")
    for _ in range(40):
        page.press("Tab")
        found = page.run("(({ id, name, className }) => id || name || className)(document.activeElement)")
        reached.add(found)
    return reached


def answer_with(page: Page) -> None:
    page.run(f"({FILL})('answer', '7,848')")
    page.run("document.getElementById('give').click()")
    assert "two ways" in page.run("document.querySelector('#answer .play-said').textContent")
    page.run(f"({FILL})('answer', '7.848')")
    page.run("document.getElementById('give').click()")
    page.run("scrollTo(0, document.body.scrollHeight)")
    assert page.run("document.querySelector('dialog[open]').textContent").startswith("7.848 m/s")
    page.run("document.getElementById('confirm').click()")
    page.wait("document.getElementById('budget').textContent === 'Correct, in 3 of 20 iterations.'")
    assert "Key7.848 m/s" in page.run("document.getElementById('end').textContent")
    # The verdict is in view and has the focus, wherever the person was on the page.
    page.wait(
        "(({ top, bottom }) => top >= 0 && bottom <= innerHeight)"
        "(document.querySelector('#end h2').getBoundingClientRect())"
    )
    assert page.run("document.activeElement.id") == "end"
    assert page.run("document.documentElement.scrollHeight > innerHeight"), "there was something to scroll"
    page.run("[...document.querySelectorAll('#end button')].at(-1).click()")


def red_pixels(page: Page, file: Path) -> int:
    """Count the pixels with the colour of the ball in a screenshot of the scene, without the axes at its left edge."""
    box = "(({ left, top, right, height }) => [left + 80, top, right, top + height])"
    corners = page.run(f"{box}(document.querySelector('.lab-view canvas').getBoundingClientRect())")
    page.picture(file, whole=False)
    with Image.open(file) as picture:
        red, green, blue = np.moveaxis(
            np.asarray(picture.convert("RGB").crop((corners[0], corners[1], corners[2], corners[3])), dtype=int), 2, 0
        )
    return int(np.count_nonzero(red > 1.5 * np.maximum(green, blue)))


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_a_person_fills_in_a_form_sees_what_came_back_and_answers(tmp_path: Path, host_url: str) -> None:
    assert PROGRAM
    with playing(tmp_path, host_url) as played, chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page:
        page.send("Network.enable")
        page.look(1280, "light")
        # With `prefers-reduced-motion`, the page shows the end of a step at once.
        page.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
        page.visit(played.address)
        page.wait("!document.getElementById('run').disabled")
        # Whoever opens the page sees that there is a question to answer, without scrolling.
        assert page.run("document.getElementById('give').getBoundingClientRect().bottom < innerHeight")
        assert "uses one iteration" in page.run("document.getElementById('iterations').innerText")
        page.run("document.querySelector('#question summary').click()")
        assert "you” in it means that agent" in page.run("document.querySelector('#question details').innerText")
        page.run("document.querySelector('#question summary').click()")
        reached = reached_by_tab(page)
        assert {"duration", "read_of", "run", "add", "give", "leave", "group", "lab-box lab-view"} <= reached
        experiment_with(page)
        # The keyboard rotates the scene; pointing at the ball shows the last reading of its position.
        label = "document.querySelector('.lab-label')"
        page.wait(f"{label} !== null && document.querySelector('.lab-clock').textContent === '0.800 s'")
        assert page.run("document.querySelector('.lab-play').textContent") == "▶"
        before = page.run(f"{label}.style.transform")
        page.run("document.querySelector('.lab-box').focus()")
        page.press("ArrowDown")
        page.wait(f"{label}.style.transform !== {before!r}")
        corner = page.run(
            f"(({{ x, width, bottom }}) => [x + width / 2, bottom + 10])({label}.getBoundingClientRect())"
        )
        page.send("Input.dispatchMouseEvent", type="mouseMoved", x=corner[0], y=corner[1])
        page.wait(f"document.querySelector('.lab-tip').textContent === 'ball{READ}'")
        answer_with(page)
        assert "Correct" in played.end()
        assert [one for one in page.complaints if "GPU stall" not in one] == []
        assert all(address.startswith(played.address) for address in page.requests)
    assert episode_in(tmp_path).answer == 7.848


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_the_scale_stays_while_the_ball_is_in_the_picture_and_a_fallen_ball_is_still_seen(
    tmp_path: Path, host_url: str
) -> None:
    assert PROGRAM
    strong = ("--seed", "5")  # the ball falls 6 m
    with (
        playing(tmp_path, host_url, *strong) as played,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.look(1280, "light")
        page.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
        page.visit(played.address)
        page.wait("!document.getElementById('run').disabled")
        scales: list[tuple[str, str]] = []
        for time, duration in (("0.010", "0.01"), ("0.020", "0.01"), ("0.820", "0.8"), ("0.830", "0.01")):
            page.run(f"({FILL})('duration', '{duration}')")
            page.run("document.getElementById('run').click()")
            page.wait(f"document.querySelector('.lab-clock').textContent === '{time} s'")
            page.run("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(() => drawn(true))))")
            # The bar is as many pixels long as its length is on the screen.
            bar = page.run(
                "(({ textContent, style }) => `${textContent} is ${style.width}`)(document.querySelector('.lab-scale'))"
            )
            scales.append((bar, page.run("document.querySelector('.lab-grid').textContent")))
        assert scales[0] == scales[1], "nothing left the picture"
        assert scales[1] != scales[2], "the ball fell out of it"
        assert scales[2][1] == "grid 1 m"
        assert scales[2] == scales[3], "and the picture does not jump back"
        assert red_pixels(page, tmp_path / "fallen.png") > 20


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_dragging_an_object_draws_a_force_within_the_limit_into_the_form_and_sends_nothing(
    tmp_path: Path, host_url: str
) -> None:
    assert PROGRAM
    # The glider is not drawn: it is dragged at the place of its last reading.
    with (
        playing(tmp_path, host_url, scene=28) as played,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.look(1280, "light", height=1200)
        page.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
        page.visit(played.address)
        page.wait("!document.getElementById('run').disabled")
        assert "force at most 1.5 N" in page.run("document.getElementById('limits').textContent")
        page.run("document.getElementById('run').click()")
        page.wait("document.getElementById('budget').textContent === '19 of 20 iterations left'")
        page.wait("document.querySelector('.lab-read') !== null")
        ring = "(({ x, y, width, height }) => [x + width / 2, y + height / 2])"
        x, y = page.run(f"{ring}(document.querySelector('.lab-read').getBoundingClientRect())")

        def mouse(kind: str, dx: float) -> None:
            page.send("Input.dispatchMouseEvent", type=kind, x=x + dx, y=y, button="left", buttons=1, clickCount=1)

        def drag() -> None:
            mouse("mousePressed", 0)
            for dx in (20, 60, 200):  # far beyond the limit
                mouse("mouseMoved", dx)
            assert page.run("document.querySelector('.lab-forces').textContent").startswith("limit 1.5 N[1.5, 0, 0] N")

        drag()
        page.send("Input.dispatchKeyEvent", type="keyDown", key="Escape", windowsVirtualKeyCode=27)
        mouse("mouseReleased", 200)
        assert page.run("document.querySelector('[name=tool]:checked')?.value ?? 'step'") == "step"
        drag()
        mouse("mouseReleased", 200)
        fields = "['object_id', ...['x', 'y', 'z'].map((part) => `force_vector.${part}`)]"
        values = page.run(f"{fields}.map((name) => document.querySelector(`[name='${{name}}']`).value)")
        assert values == ["object_1", "1.5", "0", "0"]
        assert page.run("document.getElementById('run').textContent") == "Run 1 call, 1 iteration"
        assert (
            len(played.http.get("state", headers={"x-physment-page": page.run("sessionStorage.page")}).json()["turns"])
            == 1
        )
        assert [one for one in page.complaints if "GPU stall" not in one] == []


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_a_scene_of_which_only_one_point_is_known_has_axes_and_a_scale(tmp_path: Path, host_url: str) -> None:
    assert PROGRAM
    # No object is drawn, and the only fixed point is the end of a spring.
    with (
        playing(tmp_path, host_url, scene=101) as played,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.look(1280, "light")
        page.visit(played.address)
        page.wait("(document.querySelector('.lab-scale')?.textContent ?? '') !== ''")
        assert re.fullmatch(r"[\d.]+ m", page.run("document.querySelector('.lab-scale').textContent"))
        page.wait("!document.getElementById('run').disabled")
        page.run("document.getElementById('run').click()")
        page.wait("document.querySelector('.lab-read') !== null")
        assert re.fullmatch(r"[\d.]+ m", page.run("document.querySelector('.lab-scale').textContent"))
        assert page.run("Number(document.querySelector('.lab-read').getAttribute('cx')) > 0")


BAD = '{"acceleration": {"object_1": {"x": "wind"}}}'


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_a_law_is_stated_with_the_answer_and_a_refused_one_stays_in_its_field(tmp_path: Path, host_url: str) -> None:
    assert PROGRAM
    with (
        playing(tmp_path, host_url, scene=201) as played,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.look(1280, "light")
        page.visit(played.address)
        page.wait("!document.getElementById('run').disabled")
        assert page.run("document.getElementById('give').getBoundingClientRect().bottom < innerHeight")
        assert not page.run("document.querySelector('#law').open")
        for part in range(3):
            page.run(f"({FILL})('answer.{part}', '1')")
        give, said = "document.getElementById('give').click()", "document.getElementById('law-said').textContent"
        # Neither JSON that cannot be read nor a field that the schema does not have uses an iteration.
        page.run(f"({FILL})('law', '{{acceleration')")
        page.run(give)
        assert page.run(said).startswith("answer: law: it is not JSON")
        page.run(f"({FILL})('law', '{BAD.replace('x', 'q')}')")
        page.run(give)
        page.run("document.getElementById('confirm').click()")
        page.wait(f"{said}.startsWith('answer: law.acceleration.obj')")
        assert "20 of 20" in page.run("document.getElementById('budget').textContent")
        # The laboratory refuses an unknown name, and the answer can be given again.
        page.run(f"document.querySelector('#law').open = false, ({FILL})('law', '{BAD}')")
        page.run(give)
        assert "Your law goes with it" in page.run("document.querySelector('dialog[open]').textContent")
        page.run("document.getElementById('confirm').click()")
        page.wait("document.getElementById('budget').textContent === '19 of 20 iterations left'")
        page.wait(f"{said}.includes('wind')")
        assert page.run(said).endswith("the answer is not given")
        assert page.run("document.querySelector('#law').open")
        assert page.run("document.querySelector('[name=law]').value") == BAD
        assert page.run("document.querySelector('[name=\"answer.2\"]').value") == "1"
        # The laboratory can read the example.
        page.run(f"({FILL})('law', document.querySelector('[name=law]').placeholder)")
        page.run(give)
        assert page.run(said) == ""
        page.run("document.getElementById('confirm').click()")
        page.wait("document.getElementById('budget').textContent.includes('in 2 of 20 iterations')")
        page.run("[...document.querySelectorAll('#end button')].at(-1).click()")
        played.end()
    assert episode_in(tmp_path).turns[-1].exchanges[0].call.arguments["law"]["let"] == {"m": 1.2, "c": 0.4}


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_with_a_long_question_the_answer_box_is_visible_and_no_page_scrolls_sideways(
    tmp_path: Path, host_url: str
) -> None:
    assert PROGRAM
    with (
        playing(tmp_path, host_url, scene=99) as played,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.look(1280, "light")
        page.visit(played.address)
        page.wait("!document.getElementById('run').disabled")
        assert page.run("document.getElementById('give').getBoundingClientRect().bottom < innerHeight")
        assert page.run("document.getElementById('law') === null")
        for width in (1280, 1000, 390):
            page.look(width, "dark")
            assert page.run("document.documentElement.scrollWidth <= innerWidth")


TARGETS = """[...document.querySelectorAll('a[href], button, input, select, textarea, summary')].map((one) => {
  const target = one.matches('[type=checkbox], [type=radio]') ? one.closest('label') : one;
  const { width, height } = target.getBoundingClientRect();
  return [one.textContent || one.name, Math.min(width, height)];
}).filter(([, size]) => size > 0 && size < 24)"""
RESTING = """new Promise((done) => {
  let last = scrollY, frames = 0;
  const look = () => {
    frames = scrollY === last ? frames + 1 : 0;
    last = scrollY;
    frames < 20 ? requestAnimationFrame(look) : done(true);
  };
  look();
})"""
"""True once the page has not scrolled for 20 frames."""


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
@pytest.mark.parametrize(("scene", "marked"), [(7, ".lab-label"), (28, ".lab-read")])
def test_a_finger_draws_a_force_on_an_object_and_scrolls_the_page_elsewhere(
    scene: int, marked: str, tmp_path: Path, host_url: str
) -> None:
    assert PROGRAM
    with (
        playing(tmp_path, host_url, scene=scene) as played,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.send("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=2, mobile=True)
        page.send("Emulation.setTouchEmulationEnabled", enabled=True)
        page.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-reduced-motion", "value": "reduce"}])
        page.visit(played.address)
        page.wait("document.getElementById('run')?.disabled === false")
        page.run("document.getElementById('run').click()")
        page.wait("document.getElementById('budget').textContent === '19 of 20 iterations left'")
        for group in ("Time", "Read", "Act", "Build"):
            page.run(f"({CHOOSE})('group', '{group}')")
            assert page.run(TARGETS) == []

        def swipe(selector: str, right: float, down: float, dx: float, dy: float) -> float:
            """Swipe from a point relative to the middle of an element; return by how much the page scrolled [px]."""
            # If the page still scrolled from the previous swipe, the box would not stay in the middle.
            page.run(RESTING)
            page.run("document.querySelector('.lab-box').scrollIntoView({ block: 'center' })")
            page.run(RESTING)
            before = page.run("scrollY")
            middle = "(({ x, y, width, height }) => [x + width / 2, y + height / 2])"
            x, y = page.run(f"{middle}(document.querySelector('{selector}').getBoundingClientRect())")
            for kind, share in (("touchStart", 0.0), ("touchMove", 0.3), ("touchMove", 0.6), ("touchMove", 1.0)):
                at = {"x": x + right + share * dx, "y": y + down + share * dy}
                page.send("Input.dispatchTouchEvent", type=kind, touchPoints=[at])
            page.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
            return page.run("new Promise((done) => requestAnimationFrame(() => done(scrollY)))") - before

        page.wait(f"document.querySelector('{marked}') !== null")
        assert swipe(marked, 0, 30 if marked == ".lab-label" else 0, 0, -80) == 0
        values = "['object_id', 'x', 'y', 'z'].map((one) => one.length > 1 ? one : `force_vector.${one}`)"
        assert page.run("document.querySelector('[name=tool]:checked').value") == "apply_force"
        object_id, x, y, z = page.run(f"{values}.map((name) => document.querySelector(`[name='${{name}}']`).value)")
        assert (object_id, x, y) == ("object_1", "0", "0")
        assert float(z) > 1
        # A tap shows the last reading until the next tap.
        swipe(marked, 0, 30 if marked == ".lab-label" else 0, 0, 0)
        page.wait("document.querySelector('.lab-tip').textContent.includes('position [')")
        assert not page.run("document.querySelector('.lab-tip').hidden")
        assert swipe(".lab-box", 140, 60, 0, -150) > 50
        # The axes turn with the view; a label of an object in the middle of the picture may stay where it is.
        along_x = "+document.querySelector('line.lab-axis-x').getAttribute('x2')"
        before = page.run(along_x)
        swipe(".lab-box", 140, 60, -150, 0)
        page.wait(f"Math.abs({along_x} - {before}) > 5")


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
@pytest.mark.parametrize("width", [900, 1000, 1119])
def test_a_window_of_medium_width_shows_question_answer_and_button_without_scrolling(
    width: int, tmp_path: Path, host_url: str
) -> None:
    assert PROGRAM
    with (
        playing(tmp_path, host_url) as played,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.look(width, "light", height=768)
        page.visit(played.address)
        page.wait("document.getElementById('run')?.disabled === false")
        for part in ("question", "give", "run"):
            assert page.run(f"document.getElementById('{part}').getBoundingClientRect().bottom < innerHeight"), part
        assert page.run("document.documentElement.scrollWidth <= innerWidth")
