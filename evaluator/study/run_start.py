"""Creates the record of a run that starts or continues: its server, packs, versions and agents."""

import hashlib
import json
import platform
import subprocess
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from mcp import Client
from pydantic import JsonValue

from evaluator.errors import UsageError
from evaluator.records.episode import timestamp
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import worlds_difference
from scenes import PackFiles, pack_hash, same_packs

_PACKAGES = ("physment-mcp", "mcp", "mujoco", "pydantic", "numpy")


async def server_record(client: Client, option: str) -> ServerRecord:
    """Record the version, protocol and tools that a server reports.

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
        packs: The packs of the scenes.
        server: The server that the run is played on.
        agents: Agent → settings that decide its results besides its name.
        shard: The part of the plan to play, `i/n`; None for all of it.
    """
    return RunRecord(
        created_at=timestamp("seconds"),
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
    """Git revision of the checkout that contains this module; None outside a checkout."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        done = subprocess.run(  # noqa: S603 - a fixed command
            command, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=5, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip()


def continued(folder: RunFolder, record: RunRecord, packs: Sequence[PackFiles]) -> RunRecord:
    """The record to write: the given one for a new run, or the stored one with this start added.

    Raises:
        UsageError: The stored run has another plan, agents, packs or shard, so the results could not be combined.
    """
    if not folder.run_file.exists():
        return record
    stored = folder.read_run()
    if same_packs(stored.packs, packs):
        record = record.model_copy(update={"packs": stored.packs})
    name = stored.difference(record) or ("shard" if stored.shard != record.shard else "")
    if name == "worlds":
        clause = worlds_difference(stored.worlds, record.worlds)
        raise UsageError(f"{clause}: --resume needs the same, so name their folder by --scenes-dir, or another --out")
    if name:
        raise UsageError(
            f"{folder.path} holds a run with other {name}; --resume needs the same, or choose another --out"
        )
    return stored.model_copy(update={"resumed": (*stored.resumed, record.start())})
