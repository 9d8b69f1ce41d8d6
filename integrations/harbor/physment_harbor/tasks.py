"""Writes a Harbor task (schema 1.4) for a variant, after the reference protocol has played it once.

A task has three containers; an agent can access only the first. `main` is the agent's container, without any file of
this project. `laboratory` has the model of this variant, with its hidden values, but no answer. The verifier's
container has the answer keys, and starts after the agent's container has stopped.
"""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from evaluator import EpisodeConnector, ReferenceAgent, StoreError, ToolCall, UsageError, Verdict, grade, play
from physment_mcp import __version__, open_episode
from scenes import PackError, export_packs, find_pack, read_public

_PROGRAMS = Path(__file__).with_name("programs")
SERVICE = "laboratory"
"""Name of the container of the laboratory, and its name in the network of the task."""
_EVIDENCE = "/laboratory/calls.json"
"""Path of the call log, in the laboratory's container, which writes it, and in the verifier's container."""
_CALLS = 200
"""Smallest limit of calls for a scene without a limit; an external agent with 20 iterations has the same limit."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """The record of a variant that the reference protocol has played."""

    scene: int
    seed: int
    prompt: str
    """The opening prompt."""
    max_calls: int
    """Tool calls that an agent may make."""
    solution: tuple[ToolCall, ...]
    """The calls of the reference protocol, in order, the last one being its answer."""


async def rehearse(laboratory: EpisodeConnector, scene: int, seed: int, scenes_dir: Path | None) -> Rehearsal:
    """Let the reference protocol play a variant, and read the prompt that other agents get.

    Args:
        laboratory: Connector to the laboratory.
        scene: Id of the scene.
        seed: Seed of the variant.
        scenes_dir: Folder of complete packs; None for the suite.

    Raises:
        UsageError: There is no such scene, it has no key, or the protocol does not solve this variant.
        InfrastructureError: The laboratory failed.
    """
    played = await play(ReferenceAgent(scenes_dir), scene, seed=seed, server=laboratory, scenes_dir=scenes_dir)
    if grade(played, scenes_dir).grade.strict is not Verdict.CORRECT:
        raise UsageError(f"the reference protocol does not solve scene {scene} at seed {seed}, so it is no fair task")
    solution = tuple(exchange.call for turn in played.turns for exchange in turn.exchanges)
    max_calls = _most_calls(len(solution), scene, scenes_dir)
    prompt = open_episode(scene, seed, max_calls=max_calls, scenes_dir=scenes_dir).prompt
    return Rehearsal(scene, seed, prompt, max_calls, solution)


def _most_calls(solution: int, scene: int, scenes_dir: Path | None) -> int:
    """Return the limit on calls of a task.

    It is the scene's limit plus one for the answer. For a scene without a limit it is the solution's number of calls,
    rounded up to hundreds, but at least `_CALLS`.
    """
    limits = read_public(find_pack(scene, scenes_dir)).limits
    if limits is not None and limits.calls is not None:
        return limits.calls + 1
    return max(_CALLS, -(-solution // 100) * 100)


def write_task(rehearsal: Rehearsal, task: Path, scenes_dir: Path | None) -> None:
    """Write the folder of a task.

    Args:
        rehearsal: The variant.
        task: The folder to create. Its name becomes part of container names, which an agent can see, so it must not
            contain the seed.
        scenes_dir: Folder of whole packs; None for the suite.

    Raises:
        UsageError: Its scene cannot be exported.
        StoreError: It cannot be written.
    """
    episode = {"scene": rehearsal.scene, "seed": rehearsal.seed, "max_calls": rehearsal.max_calls}
    texts = {
        "instruction.md": _instruction(rehearsal),
        "task.toml": _TASK.format(name=task.name, scene=rehearsal.scene, evidence=_EVIDENCE, service=SERVICE),
        "environment/Dockerfile": _MAIN,
        "environment/docker-compose.yaml": _COMPOSE.format(service=SERVICE),
        "environment/laboratory/Dockerfile": _LABORATORY.format(version=__version__),
        "environment/laboratory/episode.json": json.dumps(episode) + "\n",
        "solution/calls.json": json.dumps([call.model_dump() for call in rehearsal.solution]) + "\n",
        "tests/Dockerfile": _VERIFIER.format(version=__version__),
        "tests/episode.json": json.dumps(episode) + "\n",
    }
    programs = {
        "environment/laboratory": ("start.sh", "collect.py"),
        "solution": ("solve.sh", "play.py"),
        "tests": ("test.sh",),
    }
    try:
        for name, text in texts.items():
            (task / name).parent.mkdir(parents=True, exist_ok=True)
            (task / name).write_text(text, encoding="utf-8")
        for part, names in programs.items():
            for name in names:
                shutil.copy(_PROGRAMS / name, task / part / name)
        export_packs(task / "environment/laboratory/scenes", [rehearsal.seed], [rehearsal.scene], scenes_dir)
    except PackError as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        raise StoreError(f"{task} cannot be written: {error.strerror}") from error


def _instruction(rehearsal: Rehearsal) -> str:
    return (
        f"{rehearsal.prompt.rstrip()}\n\n# Budget\n\nThe laboratory is the MCP server `physment`. You may make"
        f" {rehearsal.max_calls} tool calls, refused ones included. The task is done when `answer` has been called"
        " once; if it has not been called when you end, the task counts as failed.\n"
    )


_TASK = """\
schema_version = "1.4"
artifacts = [{{ source = "{evidence}", service = "{service}" }}]

[task]
name = "physment/{name}"
description = "Find out by experiment in a MuJoCo laboratory what the scene asks."
keywords = ["physics", "mcp", "experiment"]

[metadata]
scene = {scene}

[agent]
timeout_sec = 1800.0

[environment]
build_timeout_sec = 900.0

[[environment.mcp_servers]]
name = "physment"
transport = "streamable-http"
url = "http://{service}:8000/episodes/0/mcp"

[verifier]
timeout_sec = 300.0
environment_mode = "separate"

[verifier.environment]
network_mode = "no-network"

[[verifier.collect]]
service = "{service}"
command = "python3 /laboratory/collect.py {evidence}"
"""
_COMPOSE = """\
services:
  main:
    depends_on:
      {service}:
        condition: service_healthy
  {service}:
    build:
      context: ./{service}
    # A laboratory that was started again would be a new one, with all its calls unused.
    restart: "no"
    healthcheck:
      test:
        - CMD
        - python3
        - -c
        - import urllib.request; urllib.request.urlopen('http://127.0.0.1:8000/healthz', timeout=2)
      interval: 2s
      timeout: 5s
      retries: 60
"""
_MAIN = """\
# The agent's container: Python for the solution, and nothing of the laboratory.
FROM python:3.12-slim
WORKDIR /work
"""
_LABORATORY = """\
# Only the laboratory, and the model of one variant. The image has no answers.
FROM physment-laboratory:{version}
COPY --chown=65532:65532 . /laboratory
ENV PATH=/opt/laboratory/bin:$PATH
ENTRYPOINT []
CMD ["sh", "/laboratory/start.sh"]
"""
_VERIFIER = """\
# The evaluator with the answer keys. Root, as Harbor writes the log and reads the rewards in folders of its own.
FROM physment-evaluator:{version}
COPY . /tests
ENV PATH=/opt/evaluator/bin:$PATH
USER root
ENTRYPOINT []
"""
