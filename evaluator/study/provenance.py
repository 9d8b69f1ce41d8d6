"""Everything that decides the result of a run, for `run.json`."""

import hashlib
import json
import platform
import subprocess
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from mcp import Client

from evaluator.records import FORMAT
from evaluator.study.plan import Plan
from scenes import PackFiles, pack_hash


async def server_facts(client: Client) -> dict[str, Any]:
    """Name, version, protocol and tool-schema hash of the server behind a client."""
    tools = [tool.model_dump(mode="json", exclude_none=True) for tool in (await client.list_tools()).tools]
    info = client.server_info
    return {
        "name": info.name if info else None,
        "version": info.version if info else None,
        "protocol": client.protocol_version,
        "tools": len(tools),
        "tool_schema_hash": hashlib.sha256(json.dumps(tools, sort_keys=True).encode()).hexdigest()[:16],
    }


def run_facts(
    plan: Plan,
    packs: Sequence[PackFiles],
    server: str,
    server_said: dict[str, Any],
    agents: dict[str, Any] | None = None,
    shard: str | None = None,
) -> dict[str, Any]:
    """The contents of `run.json`.

    Args:
        plan: The matrix.
        packs: The scenes.
        server: What `--server` says.
        server_said: What the server tells of itself.
        agents: Agent → what of it decides results, beyond its name.
        shard: Which part of the run this is, `i/n`; None if it is the whole.
    """
    return {
        "format": FORMAT,
        "created_at": datetime.now(UTC).isoformat(timespec="seconds"),
        # Through JSON, so that it compares equal to what a stored run.json says.
        "plan": json.loads(json.dumps(asdict(plan))),
        "agents": json.loads(json.dumps(agents or {})),
        **({"shard": shard} if shard else {}),
        "server": {"option": server, **server_said},
        "packs": {str(files.scene_id): pack_hash(files) for files in packs},
        "versions": {
            "python": platform.python_version(),
            "platform": platform.platform(),
            **{name: _version(name) for name in ("physment-mcp", "mcp", "mujoco", "pydantic", "numpy")},
        },
        "git_revision": _git_revision(),
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _git_revision() -> str | None:
    """Revision of the checkout this runs from; None outside one."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        done = subprocess.run(  # noqa: S603 - a fixed command
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=5, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
