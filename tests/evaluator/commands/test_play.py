"""Tests of `physment-eval play` in a terminal, with input from a pipe and from a pseudo-terminal."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.records.episode import Episode, Outcome
from evaluator.store.run_folder import RunFolder
from tests.builders.commands import Done, physment_eval

COMMAND = [sys.executable, "-m", "evaluator", "play"]


def play(cwd: Path, server: str, typed: str, *words: str) -> Done:
    return physment_eval("play", *(words or ("7",)), "--server", server, "--out", "run", typed=typed, cwd=cwd)


def episode_in(cwd: Path) -> Episode:
    (episode,) = RunFolder(cwd / "run").episodes().values()
    return episode


def test_a_person_solves_a_scene_and_is_graded_like_any_agent(tmp_path: Path, host_url: str) -> None:
    done = play(tmp_path, host_url, "note it falls\nstep 0.8; get_velocity 1\n\nanswer 7.848\n")
    assert done.returncode == 0, done.stderr
    assert "# Scene: Speed of a dropped ball" in done.stdout
    assert "20 iterations left > " in done.stdout
    assert "      velocity  [0, 0, -7.848]\n" in done.stdout
    assert "Correct, in 2 of 20 iterations." in done.stdout
    names = {path.name for path in (tmp_path / "run").iterdir()}
    assert names == {"run.json", "episodes.jsonl", "grades.jsonl", "summary.json", "report.html"}
    episode = episode_in(tmp_path)
    assert (episode.key.agent, episode.key.budget, episode.answer) == ("human", 20, 7.848)
    assert [turn.reasoning for turn in episode.turns] == ["it falls", ""]
    assert RunFolder(tmp_path / "run").read_run().plan.scenes == (7,)


def test_a_person_has_a_budget_and_a_wrong_answer_is_wrong(tmp_path: Path, host_url: str) -> None:
    done = play(tmp_path, host_url, "step 0.1\nstep 0.1\nstep 0.1\nanswer 1\n", "7", "--budget", "2", "--seed", "3")
    assert done.returncode == 0, done.stderr
    assert "1 iteration left > " in done.stdout
    assert "Not correct, in 2 of 2 iterations: no answer: budget_exhausted" in done.stdout
    assert episode_in(tmp_path).key.seed == 3


def test_commands_and_mistyped_lines_cost_no_iteration(tmp_path: Path, host_url: str) -> None:
    typed = "help\nhelp step\nhelp fly\ntask\nlog\nstp\nstep 0,1\nstep 0.1\nlog\nget_position 9\nanswer x\n"
    done = play(tmp_path, host_url, typed)
    assert "  apply_force object_id force_vector\n" in done.stdout
    assert "duration  How long to simulate [s]" in done.stdout
    assert "there is no tool 'fly'" in done.stdout
    assert done.stdout.count("# Scene: ") == 2
    assert "  nothing yet\n" in done.stdout
    assert "do you mean step?" in done.stdout
    assert "0,1 is not a number such as 0.5" in done.stdout
    assert "iteration 1\n  step 0.1\n      sim_time  0.1\n" in done.stdout
    assert "  get_position 9: there is no object" in done.stdout
    assert "Not correct, in 3 of 20 iterations: " in done.stdout


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("7,848", "7,848 can be read in several ways and is not sent; write 7.848 or 7848 or [7, 848]"),
        ("−7,85 m/s", "−7,85 can be read in several ways and is not sent; write −7.85 or [−7, 85]"),
        ("1,234", "write 1.234 or 1234 or [1, 234]"),
        ("1,234,567", "write 1234567 or [1, 234, 567]"),
        ("1,234.5", "write 1234.5 or [1, 234.5]"),
        ("1.234,5", "write 1234.5 or [1.234, 5]"),
        ('["7,8", 3]', "write 7.8 or [7, 8]"),
        ("v = 7,848", "write 7.848 or"),
        ("(7,848)", "write 7.848 or"),
    ],
)
def test_an_answer_with_a_comma_that_may_be_a_decimal_sign_is_not_sent(
    written: str, said: str, tmp_path: Path, host_url: str
) -> None:
    done = play(tmp_path, host_url, f"step 0.8\nanswer {written}\nanswer 7.848\n")
    assert said in done.stdout
    assert "Correct, in 2 of 20 iterations." in done.stdout


@pytest.mark.parametrize(
    ("written", "sent"),
    [
        ("3.26,16.6", "3.26,16.6"),
        ("3.26, 16.6", "3.26, 16.6"),
        ("[3,848]", [3, 848]),
        ("3, 848", "3, 848"),
        ("atan2(1,2)*x", "atan2(1,2)*x"),
        ("max(x,1,2)", "max(x,1,2)"),
        ("object_1, object_2", "object_1, object_2"),
    ],
)
def test_an_answer_whose_commas_have_one_meaning_is_sent(
    written: str, sent: object, tmp_path: Path, host_url: str
) -> None:
    play(tmp_path, host_url, f"answer {written}\n")
    assert episode_in(tmp_path).answer == sent


def test_leaving_before_the_first_iteration_leaves_nothing_behind(tmp_path: Path, host_url: str) -> None:
    done = play(tmp_path, host_url, "help\nquit\n")
    assert (done.returncode, done.stderr) == (0, "")
    assert "nothing is saved" in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_leaving_later_is_recorded_as_an_episode_without_an_answer(tmp_path: Path, host_url: str) -> None:
    done = play(tmp_path, host_url, "step 0.1\n")
    assert (done.returncode, done.stderr) == (0, "")
    episode = episode_in(tmp_path)
    assert (episode.outcome, episode.error) == (Outcome.AGENT_ERROR, "the person left without an answer")
    assert len(episode.turns) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("999",), "there is no such scene"),
        (("x",), "x is not the number of a scene"),
        (("7", "--seed", "-1"), "-1 is not a seed"),
        (("7", "--server", "no-such-program --scene {scene}"), "the server command"),
        (("7", "--server", "http://127.0.0.1:9"), "nothing accepts connections there"),
    ],
)
def test_wrong_usage_gives_a_sentence_and_leaves_no_files(
    tmp_path: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", *words, "--out", str(tmp_path / "run")]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_in_use_is_not_written_to(tmp_path: Path, host_url: str) -> None:
    play(tmp_path, host_url, "answer 1\n")
    again = play(tmp_path, host_url, "answer 2\n")
    assert again.returncode == 2
    assert "holds a run already" in again.stderr
    assert episode_in(tmp_path).answer == 1


on_linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks at /proc")


@dataclass
class Screen:
    """A `physment-eval play` command on a pseudo-terminal."""

    process: subprocess.Popen[bytes]
    terminal: int
    seen: str = ""
    shown: int = field(default=0)

    def wait_for(self, text: str) -> None:
        """Read the output of the program until it contains a text, after the text that the previous call found."""
        deadline = time.monotonic() + 120
        while text not in self.seen[self.shown :]:
            assert time.monotonic() < deadline, self.seen
            if select.select([self.terminal], [], [], 0.1)[0]:
                try:
                    self.seen += os.read(self.terminal, 65536).decode("utf-8", "replace")
                except OSError:  # the other side has closed
                    assert text in self.seen[self.shown :], self.seen
        self.shown = self.seen.index(text, self.shown) + len(text)

    def wait_for_prompt(self, left: int) -> None:
        """Wait until the command prompts and sleeps, because a key may be lost while the prompt is drawn."""
        self.wait_for(f"{left} iterations left > ")
        stat = Path(f"/proc/{self.process.pid}/stat")
        deadline = time.monotonic() + 120
        while stat.read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "S":
            assert time.monotonic() < deadline
            time.sleep(0.001)

    def type(self, text: str) -> None:
        os.write(self.terminal, text.encode())


@contextmanager
def screen(cwd: Path) -> Generator[Screen]:
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "dumb", "COLUMNS": "100"}
    process = subprocess.Popen(
        [*COMMAND, "7", "--out", "run"], cwd=cwd, env=environment, stdin=theirs, stdout=theirs, stderr=theirs,
        start_new_session=True, preexec_fn=_own_terminal,  # noqa: PLW1509 - one system call, and no other way to it
    )  # fmt: skip
    os.close(theirs)
    try:
        yield Screen(process, ours)
    finally:
        process.kill()
        process.wait()
        os.close(ours)


def _own_terminal() -> None:
    """Make the pseudo-terminal the controlling terminal, so that its Ctrl-C reaches the process."""
    import fcntl
    import termios

    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


@on_linux
def test_a_terminal_completes_names_and_ctrl_d_leaves(tmp_path: Path) -> None:
    pytest.importorskip("readline")
    with screen(tmp_path) as terminal:
        terminal.wait_for_prompt(20)
        terminal.type("get_vel\tobje\t\n")
        terminal.wait_for("get_velocity object_1")
        terminal.wait_for("velocity  [0, 0, 0]")
        terminal.wait_for_prompt(19)
        terminal.type("\x04")
        terminal.wait_for("run folder")
        assert terminal.process.wait(timeout=300) == 0
    assert episode_in(tmp_path).outcome is Outcome.AGENT_ERROR


@on_linux
def test_ctrl_c_leaves_without_a_traceback(tmp_path: Path) -> None:
    with screen(tmp_path) as terminal:
        terminal.wait_for_prompt(20)
        terminal.type("\x03")
        terminal.wait_for("nothing is saved")
        assert terminal.process.wait(timeout=300) == 0
        assert "Traceback" not in terminal.seen
    assert list(tmp_path.iterdir()) == []


@on_linux
def test_an_interrupt_signal_while_waiting_for_a_line_leaves_too(tmp_path: Path) -> None:
    with screen(tmp_path) as terminal:
        terminal.wait_for_prompt(20)
        terminal.type("step 0.1\n")
        terminal.wait_for_prompt(19)
        terminal.process.send_signal(signal.SIGINT)
        terminal.wait_for("run folder")
        assert terminal.process.wait(timeout=300) == 0
    assert len(episode_in(tmp_path).turns) == 1
