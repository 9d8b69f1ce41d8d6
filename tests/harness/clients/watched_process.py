"""Forwards messages between a client and a laboratory on stdio, and records them.

python watched_process.py FILE COMMAND...    appends a JSON line for each message to FILE
"""

import json
import os
import signal
import subprocess
import sys
import threading
from typing import IO


def pump(source: IO[bytes], sink: IO[bytes], speaker: str, notes: int) -> None:
    """Forward messages, one per line, until the stream ends."""
    for line in iter(source.readline, b""):
        note = {"process": os.getpid(), "speaker": speaker, "message": json.loads(line)}
        os.write(notes, json.dumps(note).encode() + b"\n")  # one write, because other processes append too
        try:
            sink.write(line)
            sink.flush()
        except BrokenPipeError:
            break
    sink.close()


def main(file: str, *command: str) -> int:
    """Run the command until its client closes the connection; returns its exit code."""
    notes = os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as laboratory:
        signal.signal(signal.SIGTERM, lambda *_: laboratory.terminate())
        assert laboratory.stdin is not None
        assert laboratory.stdout is not None
        # A daemon, because a blocking read of our stdin cannot be interrupted.
        threading.Thread(target=pump, args=(sys.stdin.buffer, laboratory.stdin, "client", notes), daemon=True).start()
        pump(laboratory.stdout, sys.stdout.buffer, "laboratory", notes)
        return laboratory.wait()


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
