"""Tests of worker processes: the output of a job, errors, cancellation, and a parent that was killed."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import anyio
import pytest

from evaluator.certify.processes import in_processes
from evaluator.errors import InfrastructureError
from tests.builders.paths import ROOT


def loud(number: int) -> int:
    """Write to the standard output as LAPACK does, without Python's buffers."""
    os.write(1, b" ** On entry to DLASCL parameter number  4 had an illegal value\n")
    os.write(2, b"and to the standard error\n")
    return number * number


def ending(number: int) -> int:
    """End the process instead of returning."""
    os._exit(number)


def failing(number: int) -> int:
    """Raise an exception."""
    raise ZeroDivisionError(number)


def waiting(folder: Path, number: int) -> int:
    """Write the number of this process into a file, then wait."""
    part = folder / f"{number}.part"
    part.write_text(str(os.getpid()))
    part.rename(folder / str(number))
    time.sleep(120)
    return number


def is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    status = Path(f"/proc/{process}/stat")
    return not status.exists() or status.read_text().rpartition(")")[2].split()[0] != "Z"


def ended(process: int) -> bool:
    """Wait until a process has ended, for at most 20 s."""
    deadline = time.monotonic() + 20
    while is_running(process) and time.monotonic() < deadline:
        time.sleep(0.05)
    return not is_running(process)


def written(file: Path) -> int:
    """Wait for the file of a process."""
    deadline = time.monotonic() + 60
    while not file.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    return int(file.read_text())


def test_what_a_job_writes_is_discarded(capfd: pytest.CaptureFixture[str]) -> None:
    found: dict[int, int] = {}
    anyio.run(in_processes, range(4), lambda job: partial(loud, job), 2, found.__setitem__)
    assert found == {0: 0, 1: 1, 2: 4, 3: 9}
    assert capfd.readouterr() == ("", "")


def test_an_exception_of_a_job_is_raised() -> None:
    with pytest.raises(ExceptionGroup) as raised:
        anyio.run(in_processes, [3], lambda job: partial(failing, job), 1, dict[int, int]().__setitem__)
    assert raised.group_contains(ZeroDivisionError)
    assert not multiprocessing.active_children()


def test_a_process_that_ends_before_its_job_is_one_sentence() -> None:
    with pytest.raises(ExceptionGroup) as raised:
        anyio.run(in_processes, [3], lambda job: partial(ending, job), 1, dict[int, int]().__setitem__)
    assert raised.group_contains(InfrastructureError, match="a worker process ended before its job")


def test_cancelling_ends_the_processes_at_once(tmp_path: Path) -> None:
    async def cancelled() -> None:
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(
                in_processes, range(5), lambda job: partial(waiting, tmp_path, job), 1, dict[int, int]().__setitem__
            )
            await anyio.to_thread.run_sync(written, tmp_path / "0")
            tasks.cancel_scope.cancel()

    anyio.run(cancelled)
    assert ended(written(tmp_path / "0"))
    assert not (tmp_path / "1").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
def test_the_processes_end_with_a_parent_that_was_killed(tmp_path: Path) -> None:
    code = (
        "import anyio\nfrom functools import partial\nfrom pathlib import Path\n"
        "from evaluator.certify.processes import in_processes\n"
        "from tests.evaluator.certify.test_processes import waiting\n"
        "if __name__ == '__main__':\n"
        f"    work = lambda job: partial(waiting, Path({str(tmp_path)!r}), job)\n"
        "    anyio.run(in_processes, [0], work, 1, print)\n"
    )
    program = tmp_path / "program.py"
    program.write_text(code)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, str(program)], env=environment)
    worker = written(tmp_path / "0")
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert ended(worker)
