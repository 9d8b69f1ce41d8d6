"""Tests with the real Harbor, which reads the tasks and runs trials: schema, agent, log collection, verifier."""

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.builders.commands import physment_eval
from tests.builders.paths import ROOT
from tests.integrations.playing import ENVIRONMENTS

PROGRAM = Path(__file__).parent / "programs" / "harbor_trial.py"

READ = """if True:
    import json, sys, yaml
    from pathlib import Path
    from importlib.metadata import version
    from harbor.models.task.task import Task
    from harbor.models.task.config import TaskConfig
    from harbor.models.task.verifier_mode import resolve_verifier_environment_definition

    folder = Path(sys.argv[1])
    task = Task(folder)
    config = task.config
    verifier = resolve_verifier_environment_definition(config, task.paths)
    print(json.dumps({
        "version": version("harbor"),
        "valid": Task.is_valid_dir(folder),
        "unknown": sorted(set(TaskConfig.model_validate_toml(config.model_dump_toml()).model_extra or ())),
        "schema": [config.schema_version, TaskConfig().schema_version],
        "name": task.name,
        "instruction": task.instruction == task.paths.instruction_path.read_text(),
        "servers": [server.model_dump(exclude_defaults=True) for server in config.environment.mcp_servers],
        "verifier": [str(verifier.directory.relative_to(folder)), verifier.bundled_tests],
        "network": verifier.config.network_mode.value,
        "collect": [hook.service for hook in config.verifier.collect],
        "artifacts": [artifact.model_dump(exclude_defaults=True) for artifact in config.artifacts],
        "solution": task.paths.discovered_solve_path.name,
        "services": sorted(yaml.safe_load((folder / "environment/docker-compose.yaml").read_text())["services"]),
    }))
"""


@pytest.fixture(scope="module")
def python() -> Path:
    found = ENVIRONMENTS / "harbor" / "bin" / "python"
    if not found.exists():
        pytest.skip("Harbor is not here; `python -m tests.harness.frameworks harbor` installs it")
    return found


@pytest.fixture(scope="module")
def folder(python: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A task."""
    tasks = tmp_path_factory.mktemp("harbor") / "tasks"
    assert physment_eval("harbor", "write", tasks, "--scenes", "7", "--seeds", "1000").returncode == 0
    return tasks / "scene7-1"


def namespaces_work() -> bool:
    """Return whether this system lets the tests create the namespaces that replace containers."""
    words: Sequence[str] = ("unshare", "-n", "-m", "sh", "-c", "ip link set lo up && mount --bind /usr /usr")
    try:
        return os.geteuid() == 0 and subprocess.run(words, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


def test_harbor_reads_a_task_as_it_is_meant(python: Path, folder: Path) -> None:
    done = subprocess.run([python, "-c", READ, folder], capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    said = json.loads(done.stdout)
    assert said.pop("version").startswith("0.24.")
    assert said == {
        "valid": True,
        "unknown": [],
        "schema": ["1.4", "1.4"],
        "name": "physment/scene7-1",
        "instruction": True,
        "servers": [
            {
                "name": "physment",
                "transport": "streamable-http",
                "url": "http://laboratory:8000/episodes/0/mcp",
            }
        ],
        # The verifier is a container of its own, made of tests/, without a network.
        "verifier": ["tests", True],
        "network": "no-network",
        "collect": ["laboratory"],
        "artifacts": [{"source": "/laboratory/calls.json", "service": "laboratory"}],
        "solution": "solve.sh",
        "services": ["laboratory", "main"],
    }


def test_in_trials_of_harbor_the_solution_scores_1_and_an_agent_that_forges_evidence_0(
    python: Path, folder: Path, tmp_path: Path
) -> None:
    if not namespaces_work():
        pytest.skip("needs Linux, root, and leave to make mount and network namespaces")
    programs = [Path(sys.executable).parent, Path(sys.base_prefix) / "bin", "/usr/bin", "/bin"]
    places = {
        "folders": sorted({str(Path(sys.prefix).resolve()), sys.prefix, sys.base_prefix, str(ROOT)}),
        "path": os.pathsep.join(map(str, programs)),
        "python_path": str(ROOT),
    }
    done = subprocess.run(
        [python, PROGRAM, tmp_path, json.dumps(places), folder, "oracle", "nop", "forger"],
        capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    said = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert len(said) == 4, done.stdout[-2000:] + done.stderr[-2000:]
    oracle, nop, asked, forger = said
    assert [trial["failure"] for trial in (oracle, nop, forger)] == [None] * 3
    assert [trial["rewards"]["reward"] for trial in (oracle, nop, forger)] == [1, 0, 0]
    assert (forger["rewards"]["answered"], forger["rewards"]["calls"]) == (0, 0)
    assert asked == {"statuses": ["401", "401", "401"], "seen": []}
