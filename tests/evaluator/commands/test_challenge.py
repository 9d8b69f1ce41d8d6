"""Tests of `physment-eval challenge`: twenty participants at once over HTTP, pages in Chromium, and isolation of
participants.
"""

import csv
import json
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from evaluator.commands.program import main
from evaluator.records.episode import EpisodeKey, Outcome
from evaluator.store.run_folder import RunFolder
from tests.builders.chromium import SOFTWARE_WEBGL, Page, chromium, installed, separate_tabs

PROGRAM = installed()
FALL = [
    {"tool": "step", "arguments": {"duration": 0.8}},
    {"tool": "get_velocity", "arguments": {"object_id": "object_1"}},
]


def answer(value: object) -> dict[str, Any]:
    return {"tool": "answer", "arguments": {"answer": value}}


class Challenge:
    """A running `physment-eval challenge` command."""

    def __init__(self, process: "subprocess.Popen[str]", folder: Path) -> None:
        assert process.stdout is not None
        self.process = process
        said = process.stdout.readline()
        self.here = re.findall(r"http://127\.0\.0\.1:\d+", said)[0] if "serving" in said else ""
        self.said = said
        with folder.with_name("run-links.csv").open(encoding="utf-8") as table:
            self.links = {row["code"]: row["link"] for row in csv.DictReader(table)}

        self.people: list[Person] = []

    def person(self, code: str) -> "Person":
        self.people.append(Person(self.links[code]))
        return self.people[-1]

    def end(self) -> str:
        """Send Ctrl-C to the command, and return its output until it ends."""
        self.process.send_signal(signal.SIGINT)
        out, _ = self.process.communicate(timeout=300)
        return self.said + out


class Person:
    """A simulated participant: sends the same HTTP requests as the page in the browser."""

    def __init__(self, link: str) -> None:
        self.http = httpx.Client(base_url=link, headers={"x-physment-page": "one"}, timeout=300, trust_env=False)

    def state(self, **holds: Any) -> dict[str, Any]:
        version = -1
        while True:
            state = self.http.get("state", params={"after": version}).json()
            if all(state[name] == value for name, value in holds.items()):
                return state
            version = state["version"]

    def post(self, path: str, **body: Any) -> httpx.Response:
        return self.http.post(path, json=body) if body else self.http.post(path)

    def agree(self) -> None:
        assert self.post("agree").status_code == 204

    def turn(self, *calls: dict[str, Any]) -> dict[str, Any]:
        """Take a turn, and return the state after it."""
        now = self.state(waiting=True)
        done = self.post("turn", calls=list(calls), note="")
        assert done.status_code == 204, done.text
        return self.after(now["version"] + 1)

    def after(self, version: int) -> dict[str, Any]:
        """Poll until the person may take a turn or the episode has ended; return that state."""
        while True:
            state = self.http.get("state", params={"after": version}).json()
            if state["waiting"] or state["ended"] is not None:
                return state
            version = state["version"]

    def next(self) -> None:
        assert self.http.post("next", params={"play": "next"}).status_code == 204


@contextmanager
def running(cwd: Path, server: str, *words: str) -> Generator[Challenge]:
    command = [sys.executable, "-m", "evaluator", "challenge", "run", "--server", server, *words]
    with subprocess.Popen(command, cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        challenge = Challenge(process, cwd / "run")
        try:
            yield challenge
        finally:
            process.kill()
            for person in challenge.people:
                person.http.close()


def keys_in(cwd: Path) -> list[EpisodeKey]:
    return list(RunFolder(cwd / "run").episodes())


def test_twenty_people_play_at_once_and_the_run_is_an_ordinary_one(tmp_path: Path, host_url: str) -> None:
    """Only the tenth person answers right."""
    together = threading.Barrier(20)

    def play(person: Person, number: int) -> list[str]:
        person.agree()
        person.state(waiting=True)
        together.wait()  # now every participant has an open episode
        assert person.turn(*FALL)["left"] == 19
        ends = [person.turn(answer(7.848 * number / 10))["ended"]]
        person.next()
        person.state(waiting=True, number=2)
        assert person.post("leave").status_code == 204
        return [*ends, person.state(waiting=False, number=2, end=END)["ended"]]

    with running(tmp_path, host_url, "--people", "20", "--scenes", "7,8", "--organiser", "the teacher") as challenge:
        assert list(challenge.links) == [f"{number:02}" for number in range(1, 21)]
        with ThreadPoolExecutor(20) as pool:
            people = [challenge.person(code) for code in challenge.links]
            ends = list(pool.map(play, people, range(1, 21)))
        out, _ = challenge.process.communicate(timeout=300)
        assert challenge.process.returncode == 0
    assert {end for end, _ in ends} == {"Your answer is recorded."}
    last = [end for _, end in ends]
    assert last[6] == "That was all. Thank you. To have your data deleted, give your code, 07, to the teacher."
    run = RunFolder(tmp_path / "run")
    episodes = run.episodes()
    assert {(key.epoch, key.scene) for key in episodes} == {(n, scene) for n in range(1, 21) for scene in (7, 8)}
    assert {key.agent for key in episodes} == {"human"}
    outcomes = {
        key.scene: {one.outcome for other, one in episodes.items() if other.scene == key.scene} for key in episodes
    }
    assert outcomes == {7: {Outcome.ANSWERED}, 8: {Outcome.AGENT_ERROR}}
    right = [key.epoch for key, grade in run.grades().items() if grade.grade.strict == "correct"]
    assert right == [10]
    assert "agent_error 20   answered 20" in out
    assert main(["report", str(run.path)]) == 0
    assert main(["compare", str(run.path), str(run.path)]) == 0
    assert main(["calibrate", str(run.path), "--out", str(tmp_path / "calibration")]) in {0, 2}


@pytest.mark.extended
@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed, so no page is opened")
def test_twenty_people_play_at_once_in_browsers_and_report_and_compare_take_the_run(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Participants with odd codes answer with the value that they read, those with even codes with half of it."""
    assert PROGRAM
    together = threading.Barrier(20)

    def play(page: Page, code: str, link: str) -> str:
        page.visit(link)
        page.wait("!document.getElementById('consent').hidden")
        assert f"under the code {code}, without my name" in page.run("document.getElementById('consent').innerText")
        page.run("document.getElementById('agree').click()")
        page.wait("!document.getElementById('run').disabled")
        together.wait()  # now every participant has an open episode
        page.run("document.querySelector('[name=duration]').value = '0.8', document.getElementById('run').click()")
        page.wait("document.getElementById('budget').textContent === '19 of 20 iterations left'")
        read = page.run("/velocity \\[0, 0, -([\\d.]+)\\]/.exec(document.getElementById('last').innerText)[1]")
        given = float(read) / (1 if int(code) % 2 else 2)
        page.run(f"document.querySelector('[name=answer]').value = '{given}', document.getElementById('give').click()")
        page.run("document.getElementById('confirm').click()")
        page.wait("!document.getElementById('end').hidden")
        assert page.complaints == []
        return page.run("document.getElementById('end').innerText")

    run = RunFolder(tmp_path / "run")
    with (
        running(tmp_path, host_url, "--people", "20", "--scenes", "7") as challenge,
        # Outlines instead of WebGL, because twenty pictures are slow without a graphics card.
        separate_tabs(PROGRAM, tmp_path / "profile", 20, "--disable-3d-apis") as pages,
        ThreadPoolExecutor(20) as pool,
    ):
        ends = list(pool.map(play, pages, challenge.links, challenge.links.values()))
        challenge.process.communicate(timeout=300)
        assert challenge.process.returncode == 0
    assert all(end.startswith("That was all. Thank you.") for end in ends)
    episodes = run.episodes()
    assert sorted((key.agent, key.epoch, key.scene) for key in episodes) == [("human", n, 7) for n in range(1, 21)]
    assert {episode.outcome for episode in episodes.values()} == {Outcome.ANSWERED}
    right = {key.epoch for key, grade in run.grades().items() if grade.grade.strict == "correct"}
    assert right == set(range(1, 21, 2))
    assert main(["report", str(run.path)]) == 0
    assert "Speed of a dropped ball" in (run.path / "report.html").read_text("utf-8")
    capsys.readouterr()
    assert main(["compare", str(run.path), str(run.path)]) == 0
    assert "cannot be told apart on 20 common episodes of 1 scene" in capsys.readouterr().out


END: Any = {"correct": None, "key": None, "answer": None, "choices": {}, "report": False}


def test_one_person_can_neither_see_nor_touch_the_episode_of_another(tmp_path: Path, host_url: str) -> None:
    with running(tmp_path, host_url, "--people", "2", "--scenes", "7") as challenge:
        one, two = challenge.person("01"), challenge.person("02")
        one.agree()
        one.turn(*FALL)
        seen = one.state(waiting=True)
        other = two.state()
        assert (other["turns"], other["view"], other["person"]["code"], other["person"]["agreed"]) == (
            [],
            None,
            "02",
            False,
        )
        assert two.post("turn", calls=FALL, note="").status_code == 409
        assert two.http.post("next", params={"play": "next"}).status_code == 409
        for path in ("leave", "take-over", "close"):
            assert two.post(path).status_code == 204
        assert one.state(waiting=True)["version"] == seen["version"], "nothing reaches the other person"
        # A guessed link, or a part of a true one, is refused for every kind of request.
        token = challenge.links["01"].split("/")[-2]
        guesses = [
            "x" * 22,
            token[:-1],
            token.swapcase(),
            f"{token}0",
            "..",
            "%2e%2e",
            "01",
            token.replace(token[0], "%00", 1),
        ]
        with httpx.Client(trust_env=False, timeout=300) as stranger:
            for guess in guesses:
                for path in ("", "state", "report"):
                    found = stranger.get(f"{challenge.here}/{guess}/{path}", follow_redirects=False)
                    assert found.status_code in {404, 307}, (guess, path)
                assert stranger.post(f"{challenge.here}/{guess}/agree").status_code in {404, 405}
        # Other hosts, pages of other sites, and forms without the number of a window are refused.
        link = challenge.links["01"]
        named = {"x-physment-page": "one"}
        with httpx.Client(base_url=link, trust_env=False, timeout=300) as other_window:
            # A window that has sent nothing for a while counts as closed, so this one asks first.
            one.http.get("state")
            refused = [
                other_window.post("leave", headers={"x-physment-page": "other"}),
                other_window.post("leave"),
                other_window.get("", headers={"host": "evil.example"}),
                other_window.post("leave", headers={**named, "origin": "https://evil.example"}),
                other_window.post("leave", headers={**named, "origin": "null"}),
                other_window.post("turn", headers=named, content=b" " * 200_000),
            ]
        assert [reply.status_code for reply in refused] == [409, 409, 403, 403, 403, 413]
        assert one.http.get("report").status_code == 404
        assert one.state(waiting=True)["left"] == 19
        # No response contains the key or the verdict.
        last = one.turn(answer(1))
        assert (last["end"]["correct"], last["end"]["key"]) == (None, None)
        assert "7.848" in json.dumps(last["turns"]), "the reading"
        assert "7.848" not in json.dumps({name: part for name, part in last.items() if name not in {"turns", "view"}})
    assert [key.epoch for key in keys_in(tmp_path)] == [1]


def test_a_restart_goes_on_with_the_same_links_and_what_was_played_stays_played(tmp_path: Path, host_url: str) -> None:
    words = ("--people", "2", "--scenes", "7,8", "--seeds", "0,1", "--feedback")
    with running(tmp_path, host_url, *words) as challenge:
        links, person = challenge.links, challenge.person("02")
        assert (tmp_path / "run-links.csv").stat().st_mode & 0o077 == 0
        person.agree()
        assert person.turn(*FALL, answer(0))["ended"] == "Not correct, in 1 of 20 iterations."
        person.next()
        person.turn({"tool": "step", "arguments": {"duration": 0.1}})
        waiting = challenge.person("01")
        waiting.agree()
        waiting.state(waiting=True)
        assert "Traceback" not in challenge.end()
    found = {key: episode.error for key, episode in RunFolder(tmp_path / "run").episodes().items()}
    # A participant without a turn is not recorded; for another one, the end of the challenge is recorded as the reason.
    assert [(key.epoch, key.scene, key.seed) for key in found] == [(2, 7, 1), (2, 8, 1)]
    assert list(found.values()) == [None, "the challenge was ended"]
    stored = [file.read_text("utf-8") for file in (tmp_path / "run").glob("*.json*")]
    tokens = [link.split("/")[-2] for link in links.values()]
    assert not [token for token in tokens for text in stored if token in text], "the folder can be passed on"
    with running(tmp_path, host_url) as challenge:
        tails = [[link.split("/")[-2] for link in those.values()] for those in (links, challenge.links)]
        assert tails[0] == tails[1]
        assert challenge.person("02").state(waiting=False, end=END)["ended"].startswith("That was all.")
        again = challenge.person("01")
        assert again.state(waiting=True)["person"]["agreed"]
        last = again.turn(*FALL, answer(7.848))
        assert (last["ended"], last["end"]["key"]) == ("Correct, in 1 of 20 iterations.", None)
        challenge.end()
    assert [(key.epoch, key.scene, key.seed) for key in keys_in(tmp_path)] == [(2, 7, 1), (2, 8, 1), (1, 7, 0)]


def test_an_answer_is_recorded_once_the_folder_can_be_written_again(tmp_path: Path, host_url: str) -> None:
    with running(tmp_path, host_url, "--people", "2", "--scenes", "7") as challenge:
        people = [challenge.person("01"), challenge.person("02")]
        for person in people:
            person.agree()
            person.state(waiting=True)
        (tmp_path / "run").rename(tmp_path / "away")
        for person in people:
            assert person.post("turn", calls=[answer(1)], note="").status_code == 204
        assert challenge.process.stdout is not None
        said = iter(challenge.process.stdout.readline, "")
        assert "cannot be written" in next(line for line in said if "retrying" in line)
        assert people[0].http.get("state").json()["ended"] is None
        (tmp_path / "away").rename(tmp_path / "run")
        for person in people:
            assert "That was all" in person.state(waiting=False, end=END)["ended"]
        challenge.process.communicate(timeout=300)
        assert challenge.process.returncode == 0
    assert sorted(key.epoch for key in keys_in(tmp_path)) == [1, 2]


def test_calls_that_are_no_json_are_refused_and_the_page_stays(tmp_path: Path, host_url: str) -> None:
    with running(tmp_path, host_url, "--people", "1", "--scenes", "7") as challenge:
        person = challenge.person("01")
        person.agree()
        person.state(waiting=True)
        for number in ("NaN", "Infinity", "1e999"):
            turn = f'{{"calls": [{{"tool": "step", "arguments": {{"duration": {number}}}}}]}}'
            refused = person.http.post("turn", content=turn)
            assert refused.status_code == 400
            assert refused.json() == {"error": "step: the arguments must be JSON, without NaN or infinities"}
        assert person.state(waiting=True)["turns"] == []


def test_the_data_of_a_person_are_deleted_by_one_command(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    note = "a thought that shall be forgotten"
    with running(tmp_path, host_url, "--people", "2", "--scenes", "7") as challenge:
        for code in ("01", "02"):
            person = challenge.person(code)
            person.agree()
            person.state(waiting=True)
            assert person.post("turn", calls=[*FALL, answer(7.848)], note=f"{note} by {code}").status_code == 204
            person.state(waiting=False, end=END)
        challenge.process.communicate(timeout=300)
    run = tmp_path / "run"
    assert main(["film", str(run)]) == 0
    assert main(["grade", str(run)]) == 0
    assert len(list((run / "films").iterdir())) == 2
    (run / "grades.1.jsonl").write_text(f"{note} by 02", "utf-8")
    (run / "my notes.txt").write_text("of the teacher", "utf-8")
    capsys.readouterr()
    assert main(["challenge", str(run), "--forget", "2"]) == 0
    said = capsys.readouterr().out
    assert "deleted what 02 did: 1 records" in said
    assert "look yourself at what else is in" in said
    assert "my notes.txt" in said
    everything = [file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()]
    assert [f"{note} by 02".encode() in content for content in everything].count(True) == 0
    assert any(f"{note} by 01".encode() in content for content in everything)
    assert [key.epoch for key in RunFolder(run).grades()] == [1]
    assert [line.split(",")[0] for line in (tmp_path / "run-links.csv").read_text("utf-8").splitlines()] == [
        "code",
        "01",
    ]
    for words, sentence in (
        (["--forget", "02"], "are deleted already"),
        (["--forget", "3"], "nobody has this code; the codes are 01 to 02"),
        (["--people", "9"], "holds a challenge, whose settings stay; leave out --people"),
    ):
        assert main(["challenge", str(run), *words]) == 2
        assert sentence in capsys.readouterr().err
    with running(tmp_path, host_url) as challenge:
        assert list(challenge.links) == ["01"]
        challenge.process.communicate(timeout=300)


@pytest.mark.extended
def test_the_time_of_a_person_ends_their_episode(tmp_path: Path, host_url: str) -> None:
    with running(tmp_path, host_url, "--people", "1", "--scenes", "7,8", "--minutes", "1") as challenge:
        person = challenge.person("01")
        person.agree()
        assert 50 < person.state(waiting=True)["person"]["seconds_left"] <= 60
        person.turn(*FALL)
        challenge.end()
    file = tmp_path / "run" / "challenge.json"
    stored = json.loads(file.read_text("utf-8"))
    (tmp_path / "run" / "episodes.jsonl").write_text("", "utf-8")
    stored["people"][0]["agreed_at"] = agreed = "2026-01-01T00:00:00+00:00"
    file.write_text(json.dumps(stored), "utf-8")
    with running(tmp_path, host_url) as challenge:
        person = challenge.person("01")
        over = person.state(waiting=False, end=END)
        assert over["ended"].startswith("The time is over. Thank you.")
        assert over["person"]["seconds_left"] == 0
        challenge.process.communicate(timeout=300)
    assert json.loads(file.read_text("utf-8"))["people"][0]["agreed_at"] == agreed
    assert keys_in(tmp_path) == []


def test_scenes_are_chosen_by_the_answers_and_the_reasons_are_recorded(tmp_path: Path, host_url: str) -> None:
    words = ("--people", "2", "--adaptive", "2", "--scenes", "7-20")
    with running(tmp_path, host_url, *words) as challenge:
        counts: list[int] = []
        for code in ("01", "02"):
            person = challenge.person(code)
            person.agree()
            count = 1
            while person.turn(answer(0))["end"]["choices"]:
                person.next()
                count += 1
                person.state(waiting=True, number=count)
            counts.append(count)
        out, _ = challenge.process.communicate(timeout=300)
    assert ": scene 19, answered" in out
    episodes = RunFolder(tmp_path / "run").episodes()
    assert all(1 <= count < 14 for count in counts)
    assert len(episodes) == sum(counts)
    assert all(episode.chosen is not None for episode in episodes.values())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--scenes", "7"], "say for how many people: --people N"),
        (["--people", "501", "--scenes", "7"], "at most 500"),
        (["--people", "2"], "say which scenes"),
        (["--people", "2", "--scenes", "7", "--difficulties", "x"], "belongs to --adaptive"),
        (["--people", "2", "--scenes", "7", "--public-address", "lab.example.org"], "https://lab.example.org"),
        (["--forget", "01"], "holds no challenge"),
    ],
)
def test_what_cannot_be_served_is_refused_in_one_sentence(
    tmp_path: Path, words: Sequence[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["challenge", str(tmp_path / "run"), *words]) == 2
    assert sentence in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_proxy_is_let_in_by_its_name_and_stands_in_the_links(tmp_path: Path, host_url: str) -> None:
    words = ("--people", "1", "--scenes", "7", "--public-address", "https://lab.example.org/physics/")
    with running(tmp_path, host_url, *words) as challenge:
        link = challenge.links["01"]
        assert link.startswith("https://lab.example.org/physics/")
        here = f"{challenge.here}/{link.split('/')[-2]}/"
        told = {"host": "lab.example.org", "origin": "https://lab.example.org"}
        assert httpx.get(here, headers=told, trust_env=False).status_code == 200
        assert httpx.get(here, headers={**told, "origin": "https://example.org"}, trust_env=False).status_code == 403
        assert "nobody has played anything" in challenge.end()


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), pytest.param(390, "dark", marks=pytest.mark.extended)])
def test_a_person_agrees_plays_and_is_thanked_in_the_browser(
    tmp_path: Path, host_url: str, width: int, scheme: str
) -> None:
    assert PROGRAM
    words = ("--people", "2", "--scenes", "7,8", "--minutes", "30", "--organiser", "the teacher")
    with (
        running(tmp_path, host_url, *words) as challenge,
        chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page,
    ):
        page.send("Network.enable")
        page.look(width, scheme)
        page.visit(challenge.links["01"])
        page.wait("!document.getElementById('consent').hidden")
        assert "under the code 01, without my name" in page.run("document.getElementById('consent').textContent")
        assert "You have 30 minutes for all scenes." in page.run("document.getElementById('consent').innerText")
        assert page.run("document.querySelector('main').offsetParent === null")
        assert page.run("document.documentElement.scrollWidth <= innerWidth")
        page.run("document.getElementById('agree').focus()")
        page.press("Enter")
        page.wait("!document.getElementById('run').disabled && document.getElementById('consent').hidden")
        assert page.run("document.getElementById('clock').textContent") == "code 01 · 30 min left"
        page.run("document.getElementById('run').click()")
        page.wait("document.getElementById('budget').textContent === '19 of 20 iterations left'")
        page.run("document.querySelector('[name=answer]').value = '7.848'")
        page.run("document.getElementById('give').click()")
        page.run("document.getElementById('confirm').click()")
        page.wait("document.getElementById('budget').textContent === 'Your answer is recorded.'")
        shown = page.run("document.getElementById('end').innerText")
        assert "Key" not in shown
        assert "Report" not in shown
        page.run("document.querySelector('#end button').click()")
        page.wait("document.querySelector('#question h2')?.textContent === 'Two balls on one slope'")
        page.wait("document.getElementById('leave')?.disabled === false")
        assert page.run("document.documentElement.scrollWidth <= innerWidth")
        page.run("window.confirm = () => true, document.getElementById('leave').click()")
        page.wait("document.getElementById('end').textContent.startsWith('That was all. Thank you.')")
        assert page.run("document.querySelectorAll('#end button').length") == 0
        assert [one for one in page.complaints if "GPU stall" not in one] == []
        assert all(address.startswith(challenge.links["01"]) for address in page.requests)
        challenge.end()
    assert len(keys_in(tmp_path)) == 2
