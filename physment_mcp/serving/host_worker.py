"""The process of one worker of a host: serves the connections that the front passes, and ends with the front."""

import contextlib
import gc
import json
import logging
import os
import signal
import socket
import sys
from pathlib import Path
from threading import Thread
from typing import NamedTuple

from physment_mcp.serving.forwarding import HostWorker
from physment_mcp.serving.frames import watching
from physment_mcp.serving.host import Host
from physment_mcp.serving.listening import serve_passed
from physment_mcp.serving.log_lines import PatientLines
from physment_mcp.serving.places import Places, shared_memory


class WorkerOptions(NamedTuple):
    """What a worker is told, on its stdin and in JSON: the token must not show in its command line."""

    number: int
    workers: int
    """How many there are."""
    source: int
    """Descriptor of the socket that brings connections."""
    memory: int
    """Descriptor of the file in which taken places are counted."""
    scenes_dir: str | None
    max_episodes: int
    idle_timeout_s: float
    token: str | None
    exposed: bool
    names: tuple[str, ...]
    observations: str
    timestep: float | None
    log_level: str


def main() -> None:
    """Serve until the front ends."""
    gc.set_threshold(10_000, 20, 20)  # as every process of this package
    told = WorkerOptions(*json.loads(sys.stdin.readline()))
    logging.basicConfig(handlers=[PatientLines()], level=told.log_level, format="%(levelname)s %(name)s: %(message)s")
    Thread(target=_end_with_front, daemon=True).start()
    folder = None if told.scenes_dir is None else Path(told.scenes_dir)
    host = Host(
        folder,
        told.max_episodes,
        told.idle_timeout_s,
        told.token,
        told.exposed,
        tuple(told.names),
        watching(told.observations, folder),
        told.timestep,
        HostWorker(told.number, told.workers),
        Places(told.max_episodes, shared_memory(told.memory, told.workers), told.number),
    )
    serve_passed(host, socket.socket(fileno=told.source), _ready)


def _ready() -> None:
    with contextlib.suppress(BrokenPipeError):  # the front has ended meanwhile
        os.write(sys.stdout.fileno(), b"\n")  # what it waits for


def _end_with_front() -> None:
    sys.stdin.read()
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
