"""Compares the packs and the generated worlds of a stored run with those that are present."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from evaluator.errors import UsageError
from evaluator.records.run import PlayedWorld, RunRecord
from scenes import (
    PackError,
    PackFiles,
    WorldError,
    default_folder,
    find_pack,
    is_world,
    one_world,
    place_of,
    reference_of,
    same_pack,
)


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
