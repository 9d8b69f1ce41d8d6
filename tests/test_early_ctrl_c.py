"""Tests of signals during imports, of Ctrl-C that Python discards, and of Ctrl-C while an episode waits."""

import signal
import subprocess
import sys

import pytest

ENGINE, MODELS = "mujoco", "mcp_types"
"""An extension in C, and a module that builds models with pydantic. A signal during the import of one of
them raises an exception, which both replace by another."""

STRUCK = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored in the background of a script
signal.signal(signal.SIGHUP, signal.SIG_DFL)
program, module, sign = sys.argv[1:4]

class Striking:
    def find_spec(self, name, path, target=None):
        if name == module:
            try:
                signal.raise_signal(signal.Signals[sign])
            except KeyboardInterrupt:
                raise ImportError("initialization failed")

sys.meta_path.insert(0, Striking())
sys.argv[1:] = sys.argv[4:]
if program == "evaluator":
    from evaluator.__main__ import entry
else:
    from physment_mcp.__main__ import entry
entry()
"""


@pytest.mark.parametrize(
    ("program", "module", "words"),
    [
        ("evaluator", "rich", ("run", "--dry-run")),
        ("evaluator", MODELS, ("run", "--dry-run")),
        ("laboratory", "pydantic", ("--scene", "7")),
        ("laboratory", ENGINE, ("--scene", "7")),
        ("laboratory", MODELS, ("serve", "--port", "0")),
    ],
)
@pytest.mark.parametrize("sign", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_while_modules_are_loaded_ends_the_program_without_a_word(
    program: str, module: str, words: tuple[str, ...], sign: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", STRUCK, program, module, sign, *words],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (-signal.Signals[sign], "", "")


@pytest.mark.parametrize("sign", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_that_is_ignored_stays_ignored(sign: str) -> None:
    source = f"import signal; signal.signal(signal.{sign}, signal.SIG_IGN)\n"
    source += STRUCK.replace("signal.default_int_handler", "signal.getsignal(signal.SIGINT)")
    source = source.replace("signal.signal(signal.SIGHUP, signal.SIG_DFL)\n", "")
    done = subprocess.run(
        [sys.executable, "-c", source, "evaluator", MODELS, sign, "run", "--scenes", "7", "--dry-run"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


DISCARDED = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_DFL)
from physment_mcp.contract.command_line import restore_sigint
restore_sigint()

class Finalised:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

class Faulty:
    def __del__(self):
        raise ValueError("of another kind")

try:
    Faulty()
    Finalised()
    time.sleep(30)
except KeyboardInterrupt:
    sys.exit("interrupted")
"""


def test_ctrl_c_in_a_finaliser_is_raised_again() -> None:
    done = subprocess.run([sys.executable, "-c", DISCARDED], capture_output=True, text=True, check=False, timeout=20)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == "interrupted"
    assert "ValueError: of another kind" in done.stderr
    assert "KeyboardInterrupt" not in done.stderr


def test_ctrl_c_ends_an_episode_on_stdio_that_waits_for_the_next_call() -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "physment_mcp", "--scene", "7"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509 - a background job ignores it
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdin.write(
            b'{"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": {"protocolVersion": "2025-06-18",'
            b' "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}}}\n'
        )
        process.stdin.flush()
        assert b'"id":1' in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.wait(60) == -signal.SIGINT
        assert process.stderr.read() == b""
