"""The real Harbor reads the tasks: schema, container files, where the verifier runs, and what it collects."""

import json
import subprocess
from pathlib import Path

import pytest

from tests.builders.commands import physment_eval
from tests.integrations.playing import ENVIRONMENTS

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
        pytest.skip("Harbor is not here; `make harbor` installs it")
    return found


def test_harbor_reads_a_task_as_it_is_meant(python: Path, tmp_path: Path) -> None:
    assert physment_eval("harbor", "write", tmp_path / "tasks", "--scenes", "7", "--seeds", "1000").returncode == 0
    folder = tmp_path / "tasks" / "scene7-1"
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
        "artifacts": [{"source": "/evidence/calls.json", "service": "laboratory"}],
        "solution": "solve.sh",
        "services": ["laboratory", "main"],
    }
