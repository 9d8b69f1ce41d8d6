"""The record of a run that starts: what decides its result, gathered from the plan, the server and this machine."""

import hashlib
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from mcp import Client
from pydantic import JsonValue

from evaluator.records.run import Plan, RunRecord, ServerRecord
from scenes import PackFiles, pack_hash

_PACKAGES = ("physment-mcp", "mcp", "mujoco", "pydantic", "numpy")


async def server_record(client: Client, option: str) -> ServerRecord:
    """What the server behind a client says about itself.

    Args:
        client: A connected client.
        option: Value of `--server`.
    """
    tools = [tool.model_dump(mode="json", exclude_none=True) for tool in (await client.list_tools()).tools]
    info = client.server_info
    return ServerRecord(
        option=option,
        name=info.name if info else None,
        version=info.version if info else None,
        protocol=client.protocol_version,
        tools=len(tools),
        tool_schema_hash=hashlib.sha256(json.dumps(tools, sort_keys=True).encode()).hexdigest()[:16],
    )


def run_record(
    plan: Plan,
    packs: Sequence[PackFiles],
    server: ServerRecord,
    agents: Mapping[str, Mapping[str, JsonValue]] | None = None,
    shard: str | None = None,
) -> RunRecord:
    """The record of a run that starts now, on this machine.

    Args:
        plan: The matrix.
        packs: The scenes.
        server: The server it is played on.
        agents: Agent → what decides its results besides its name.
        shard: Which part of the plan is played, `i/n`; None if all of it.
    """
    return RunRecord(
        created_at=datetime.now(UTC).isoformat(timespec="seconds"),
        plan=plan,
        agents={name: dict(facts) for name, facts in (agents or {}).items()},
        shard=shard,
        server=server,
        packs={str(files.scene_id): pack_hash(files) for files in packs},
        versions={
            "python": platform.python_version(),
            "platform": platform.platform(),
            **{name: _version(name) for name in _PACKAGES},
        },
        git_revision=_git_revision(),
    )


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


def _git_revision() -> str | None:
    """Revision of the checkout that this code runs from; None if it is none."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        done = subprocess.run(  # noqa: S603 - a fixed command
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=5, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()
