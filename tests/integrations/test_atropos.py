"""Tests with the real Atropos: the environment of the page plays, is rewarded, and marks the tokens of its replies."""

import contextlib
import json
import re
import subprocess
import threading
import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import anyio
import httpx

from scenes.splits import splits
from tests.builders.paths import ROOT
from tests.harness.clients.playing import LABORATORY
from tests.harness.clients.scripted_model import app, serving
from tests.integrations.playing import Stand, check_same, json_lines, rehearsed, standing
from tests.integrations.test_openenv import free_port

PAGE = ROOT / "docs" / "how-to" / "atropos.md"
TOKENIZER = Path(__file__).parent / "programs" / "chatml_tokenizer.py"
GROUPS, EPISODES = 2, 2
BUDGET = 300
"""The scripted model makes one call in an iteration."""


OFFLINE = {"HF_HUB_OFFLINE": "1", "WANDB_MODE": "disabled"}
FAILS_AT = 6
"""Request to the model before which the host is killed: both episodes of the first group are then running."""
LONGEST_S = 300.0
"""Longest wall time of a wait [s]."""


def prepared(stand: Stand, model: str = "") -> list[object]:
    """Write the program of the page and the tokenizer; returns the options of the program."""
    program = re.search(r"```python file=physment_atropos\.py\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert program
    (stand.scratch / "physment_atropos.py").write_text(program[1], encoding="utf-8")
    made = stand.run("python", TOKENIZER, stand.scratch / "tokenizer")
    assert made.returncode == 0, made.stderr[-2000:]
    words: list[object] = ["--env.group_size", EPISODES, "--env.use_wandb", "false", "--env.budget", BUDGET]
    words += ["--env.tokenizer_name", stand.scratch / "tokenizer", "--openai.base_url", f"{model or stand.model}/v1"]
    return [*words, "--openai.model_name", "scripted"]


class Host:
    """A host at a fixed address that can be killed and started again."""

    def __init__(self) -> None:
        """Choose the address."""
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Start the host, and wait until it replies."""
        self._process = subprocess.Popen([*LABORATORY, "serve", "--port", str(self.port)], stdout=subprocess.DEVNULL)
        wait_for(f"{self.url}/healthz")

    def kill(self) -> None:
        """Kill the host without notice, if it runs."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None


class Killing:
    """The scripted model, which kills a host before it replies to a request."""

    def __init__(self, host: Host) -> None:
        """Count the requests."""
        self.requests, self.killed = 0, threading.Event()
        self._host, self._app = host, app()

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        if scope["type"] == "http":
            self.requests += 1
            if self.requests == FAILS_AT:
                await anyio.to_thread.run_sync(self._host.kill)
                self.killed.set()
        await self._app(scope, receive, send)


def wait_for(url: str) -> None:
    """Wait until a server replies."""
    until = time.monotonic() + LONGEST_S
    while time.monotonic() < until:
        with contextlib.suppress(httpx.TransportError):
            httpx.get(url)
            return
        time.sleep(0.1)
    raise AssertionError(f"{url} did not reply")


@contextlib.contextmanager
def running(stand: Stand, log: str, program: str, *words: object) -> Generator[subprocess.Popen[bytes]]:
    """Run a program of the Atropos environment, and stop it at the end."""
    command = [str(stand.programs / program), *map(str, words)]
    with (
        (stand.scratch / log).open("wb") as file,
        subprocess.Popen(
            command, cwd=stand.scratch, env=stand.environment() | OFFLINE, stdout=file, stderr=file
        ) as process,
    ):
        try:
            yield process
        finally:
            process.kill()


def fetched(api: str, serve: subprocess.Popen[bytes], batches: int) -> list[dict[str, Any]]:
    """Fetch batches as a trainer; returns their groups."""
    groups: list[dict[str, Any]] = []
    until = time.monotonic() + LONGEST_S
    while batches and serve.poll() is None and time.monotonic() < until:
        batch = httpx.get(f"{api}/batch", timeout=60).json()["batch"]
        batches -= batch is not None
        groups += batch or []
        time.sleep(0.2)
    return groups


def test_a_group_whose_host_fails_is_played_again_and_a_trainer_gets_every_group_complete(tmp_path: Path) -> None:
    host = Host()
    host.start()
    killing = Killing(host)
    try:
        with standing("atropos", tmp_path, "--server", host.url) as stand, serving(killing) as model:
            words = [*prepared(stand, model), "--env.total_steps", GROUPS, "--env.ensure_scores_are_not_same", "false"]
            api = f"http://127.0.0.1:{(port := free_port())}"
            words += ["--env.rollout_server_url", api, "--env.max_num_workers_per_node", 1]
            with running(stand, "api.log", "run-api", "--host", "127.0.0.1", "--port", port):
                wait_for(api)
                trainer = {"wandb_group": "", "wandb_project": "", "checkpoint_dir": "", "save_checkpoint_interval": 0}
                trainer |= {"batch_size": EPISODES, "max_token_len": 10**6, "starting_step": 0, "num_steps": GROUPS}
                httpx.post(f"{api}/register", json=trainer).raise_for_status()
                httpx.get(f"{api}/batch").raise_for_status()  # only then may environments register
                with running(stand, "serve.log", "python", "physment_atropos.py", "serve", *words) as serve:
                    while serve.poll() is None and not killing.killed.wait(1):
                        pass
                    time.sleep(2)
                    host.start()
                    groups = fetched(api, serve, GROUPS)
            left = httpx.get(f"{stand.referee}/healthz").json()["episodes"]
            episodes = stand.folder.episodes()
    finally:
        host.kill()
    log = (tmp_path / "serve.log").read_text(encoding="utf-8")
    assert [group["scores"] for group in groups] == [[1.0] * EPISODES] * GROUPS, log[-3000:]
    # The first line says how the host failed, each further one that it was not running again yet.
    first, *others = [line for line in log.splitlines() if "is played again later" in line]
    assert "the host at" in first
    assert all("'random_seed': 1" in line for line in (first, *others))
    assert "Traceback" not in log
    # One worker plays one group at a time. The episodes of the failed group were closed without a reward.
    assert left <= EPISODES
    rewarded = [(key.scene, key.seed) for key in episodes]
    assert all(rewarded.count(variant) <= EPISODES for variant in rewarded)
    for key, episode in episodes.items():
        check_same(episode, rehearsed(key.scene, key.seed, BUDGET))


def test_the_environment_of_the_page_collects_groups_as_physment_eval_plays_them(tmp_path: Path) -> None:
    with standing("atropos", tmp_path) as stand:
        words = prepared(stand)
        collected = ["--env.total_steps", GROUPS, "--env.data_path_to_save_groups", "groups.jsonl"]
        done = stand.run("python", "physment_atropos.py", "process", *words, *collected, **OFFLINE)
        assert done.returncode == 0, done.stderr[-3000:]
        episodes = stand.folder.episodes()
        done = stand.run("python", "physment_atropos.py", "evaluate", *words, "--env.evaluated", 2, **OFFLINE)
        assert done.returncode == 0, done.stderr[-3000:]
        evaluated = stand.folder.episodes().keys() - episodes.keys()
    validation = splits()["validation"]
    assert len(evaluated) == 2
    assert all(key.scene in validation.scenes and key.seed in validation.seeds for key in evaluated)
    groups = json_lines(tmp_path / "groups.jsonl")
    assert [group["scores"] for group in groups] == [[1.0] * EPISODES] * GROUPS
    assert len(episodes) == GROUPS * EPISODES
    variants = {(key.scene, key.seed) for key in episodes}
    assert len(variants) == GROUPS
    for key, episode in episodes.items():
        check_same(episode, rehearsed(key.scene, key.seed, BUDGET))
    for group in groups:
        for tokens, masks, messages in zip(group["tokens"], group["masks"], group["messages"], strict=True):
            # The tokens of the test's tokenizer are bytes.
            trained = bytes(token for token, mask in zip(tokens, masks, strict=True) if mask != -100).decode()
            said = [message["tool_calls"][0]["function"] for message in messages if message["role"] == "assistant"]
            assert trained == "".join(f"{json.dumps(call, ensure_ascii=False)}\n" for call in said)
            assert {mask for token, mask in zip(tokens, masks, strict=True) if mask not in (-100, token)} == set()
