"""A run that was disturbed by a fault and resumed equals an undisturbed run."""

import random
import subprocess
import sys
from pathlib import Path

import pytest

from tests.harness.load import disks
from tests.harness.load.disks import may_mount
from tests.harness.load.evaluation import Broken, Evaluation
from tests.harness.load.faults import FAULTS, Undisturbed, disturb, main, undisturbed

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")

SEEDS = 1
KINDS = ("SIGTERM", "torn last line")
"""Faults that `make test` injects; before the last line is torn, SIGKILL ends the run. Each night
`tests.harness.load.faults` injects all faults."""
FURTHER = ("server killed", "worker killed", "full disk", "garbage line")


@pytest.fixture(scope="session")
def usual(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    return undisturbed(tmp_path_factory.mktemp("undisturbed") / "run", "host", SEEDS)


@pytest.mark.parametrize("kind", [*KINDS, *(pytest.param(kind, marks=pytest.mark.extended) for kind in FURTHER)])
def test_a_run_that_a_fault_strikes_is_completed_as_if_nothing_had_happened(
    tmp_path: Path, usual: Undisturbed, kind: str
) -> None:
    disturb(kind, tmp_path / "run", "host", usual, SEEDS, random.Random(f"1/{kind}"))


def test_the_kinds_of_the_suite_are_among_all() -> None:
    assert {*KINDS, *FURTHER} < set(FAULTS)


def test_a_record_that_is_missing_twice_or_unreadable_is_noticed(tmp_path: Path, usual: Undisturbed) -> None:
    run = Evaluation(tmp_path / "run", "host", SEEDS)
    run.complete()
    assert run.results() == usual.results
    file = run.folder / "episodes.jsonl"
    lines = file.read_bytes().splitlines(keepends=True)
    for damaged in (lines[1:], [*lines, lines[0]], [*lines, b"garbage\n"]):
        file.write_bytes(b"".join(damaged))
        with pytest.raises(Broken):
            run.results()


def test_a_run_that_ends_with_a_traceback_is_noticed(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "raise KeyError"]
    with (
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process,
        pytest.raises(Broken, match="no sentence of ours"),
    ):
        Evaluation(tmp_path, "host", SEEDS).wait_for(process)


def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--count", "0", "--seed", "1"]) == 0
    assert "seed 1" in capsys.readouterr().out


@pytest.mark.skipif(not may_mount(), reason="this process may not mount a file system")
def test_a_file_system_fills_up_turns_read_only_and_is_gone_afterwards(tmp_path: Path) -> None:
    def use_up() -> None:
        with disks.mounted(tmp_path):
            disks.fill(tmp_path, 10_000)
            with pytest.raises(OSError, match="No space left"):
                (tmp_path / "file").write_bytes(b"x" * 20_000)
            disks.empty(tmp_path)
            (tmp_path / "file").write_bytes(b"x" * 20_000)
            with (tmp_path / "file").open("ab"):
                assert not disks.turn(tmp_path, "ro")
            assert disks.turn(tmp_path, "ro")
            (tmp_path / "file").write_bytes(b"")

    with pytest.raises(OSError, match="Read-only"):
        use_up()
    assert not tmp_path.is_mount()
    assert list(tmp_path.iterdir()) == []
