"""Creates the record of a run that starts or continues: its server, packs, versions and agents.

Compares the packs and the generated worlds of a stored run with those that are present.
"""

import hashlib
import json
import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from mcp import Client
from pydantic import JsonValue

from evaluator.errors import UsageError
from evaluator.records.run import Plan, PlayedWorld, RunRecord, ServerRecord
from evaluator.store.run_folder import RunFolder
from scenes import (
    PackError,
    PackFiles,
    WorldError,
    default_folder,
    find_pack,
    is_world,
    one_world,
    pack_hash,
    place_of,
    reference_of,
    same_pack,
    same_packs,
)

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


def played_worlds(packs: Iterable[PackFiles], scenes_dir: Path | None) -> dict[str, PlayedWorld]:
    """Provenance of the generated worlds among packs, by reference.

    Raises:
        UsageError: The record of a world cannot be read.
    """
    folder = scenes_dir or default_folder()
    kept = [files.scene_id for files in packs if is_world(files.scene_id) and files.folder.parent != folder]
    return {reference_of(scene): _played(scene, folder) for scene in kept}


def refuse_other_worlds(run: RunRecord, scenes_dir: Path | None) -> None:
    """Raise if a run cannot be resumed because a world in the folder of packs differs from the recorded one.

    Raises:
        UsageError: A world differs or is missing.
    """
    folder = scenes_dir or default_folder()
    here = {reference: _played(one_world(reference), folder) for reference in run.worlds}
    if clause := worlds_difference(run.worlds, here):
        raise UsageError(f"{clause}; name the folder with the worlds of the run by --scenes-dir")


def other_packs(run: RunRecord, scenes_dir: Path | None) -> list[int]:
    """Return the scenes that a stored run played on packs that differ from the present ones.

    Worlds that are made from records are omitted, because `refuse_other_worlds` compares them.

    Raises:
        UsageError: A pack is missing.
    """
    made = {one_world(reference) for reference in run.worlds}
    try:
        return [
            scene
            for scene, stored in ((int(name), stored) for name, stored in run.packs.items())
            if scene not in made and not same_pack(stored, find_pack(scene, scenes_dir))
        ]
    except PackError as error:
        raise UsageError(str(error)) from error


def refuse_other_packs(run: RunRecord, scenes_dir: Path | None) -> None:
    """Raise if a stored run cannot be graded because its packs differ from the present ones.

    Raises:
        UsageError: A scene was played on another pack, or its pack is missing.
    """
    if other := other_packs(run, scenes_dir):
        raise UsageError(
            f"the run was played on another pack of scene {reference_of(other[0])} than the one here, which cannot"
            " grade it; name the folder of its packs by --scenes-dir"
        )


def worlds_difference(stored: Mapping[str, PlayedWorld], here: Mapping[str, PlayedWorld]) -> str:
    """Describe the first world whose provenance differs, as a clause; empty if all are the same."""
    for reference in (*stored, *here):
        then, now = stored.get(reference), here.get(reference)
        if then is None or now is None:
            return f"{reference} is in one of the two alone"
        if then != now:
            there, clause = _compared(then, now)
            return f"{reference} was made {there} for the run, and the one here {clause}"
    return ""


def _played(scene: int, folder: Path) -> PlayedWorld:
    from scenes.worlds.folders import find_record  # noqa: PLC0415 - it loads numpy and scipy

    try:
        record = find_record(*place_of(scene), folder)
    except WorldError as error:
        raise UsageError(f"{folder}: {error}") from error
    return PlayedWorld(
        grammar=record.grammar,
        record=record.digest,
        split=record.split,
        settings=record.settings,
        commitment=record.commitment,
    )


def _compared(then: PlayedWorld, now: PlayedWorld) -> tuple[str, str]:
    """Describe the first difference in provenance: a clause for the stored world and one for the present world."""
    if then.grammar != now.grammar:
        return f"by version {then.grammar} of the grammar", f"by version {now.grammar}"
    if then.commitment != now.commitment:
        return _key(then), _key(now)
    if then.settings != now.settings:
        return _settings(then), _settings(now)
    return f"as record {then.record}", f"as record {now.record}"


def _key(world: PlayedWorld) -> str:
    return f"with the key of commitment {world.commitment[:16]}…" if world.commitment else "without a key"


def _settings(world: PlayedWorld) -> str:
    return f"with {', '.join(world.settings)}" if world.settings else "with the settings of its level"
