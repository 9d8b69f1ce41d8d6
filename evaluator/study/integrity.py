"""Checks before a stored run is trusted and graded: seal of its records, key of held-back seeds, packs and worlds."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from evaluator.errors import StoreError, UsageError, reason_of
from evaluator.records.episode import FORMAT, Record
from evaluator.records.run import PlayedWorld, RunRecord, SeedKey, SeedOf, seed_as_recorded
from evaluator.store.durable import Seal
from evaluator.store.run_folder import RunFolder
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


class Sealing:
    """The seal of a run that is being played. It stays in memory until the run ends."""

    def __init__(self, folder: RunFolder, *, trust: bool = False, damage: Sequence[str] = ()) -> None:
        """Begin the seal of a new run, or continue that of an interrupted one.

        Args:
            folder: The run; its damaged lines have been moved to another file.
            trust: Whether to accept records that do not match their seal.
            damage: A sentence for each line that was set aside. If there are any, the seal cannot be verified.

        Raises:
            StoreError: The records do not match their seal.
        """
        stored = folder.read_seal() or Seal()
        lines = folder.episode_lines()
        problem = stored.problem(lines)
        if problem and not damage:
            _refuse(folder, problem, trust=trust)
        self.seal = Seal()
        for line in lines:
            self.add(line)
        found = stored.found + max(0, len(lines) - stored.lines)
        edited = (*stored.edited, *damage, *([problem] if problem and not damage else []))
        self.seal = self.seal.model_copy(update={"found": found, "edited": edited})

    def add(self, line: bytes) -> None:
        """Add an episode to the seal.

        Args:
            line: The episode's line of `episodes.jsonl`, without the line feed.
        """
        self.seal = self.seal.after(line)

    def sentence(self) -> str:
        """State the size and the last hash of the seal, so that the operator can store them outside the run folder."""
        return f"seal: {self.seal.lines} episodes, {self.seal.head}"


def seal_note(folder: RunFolder, *, trust: bool = False) -> str:
    """Describe the seal of a stored run in a clause for its report.

    Args:
        folder: The run.
        trust: Whether to accept records that do not match their seal; the clause then says so.

    Raises:
        StoreError: The records do not match their seal.
    """
    seal = folder.read_seal()
    if seal is None:
        return "not sealed: nothing tells whether they are as they were written"
    lines = folder.episode_lines()
    problem = seal.problem(lines)
    if problem:
        _refuse(folder, problem, trust=trust)
        return f"NOT as they were sealed: {problem}; taken all the same, as the operator asked"
    remarks = [*seal.edited]
    if seal.found:
        remarks.append(f"{seal.found} of them were sealed as they were found after the run had been killed")
    if len(lines) > seal.lines:
        remarks.append(f"{len(lines) - seal.lines} more are not sealed, because the run was killed")
    return "; ".join([f"{seal.lines} sealed, {seal.head}", *remarks])


def _refuse(folder: RunFolder, problem: str, *, trust: bool) -> None:
    folder.episodes()  # raises an error that names the line if a line cannot be parsed
    if not trust:
        raise StoreError(
            f"{folder.episodes_file} is not what the run wrote: {problem}; --allow-modified goes on with it, and the"
            " report says so"
        )


class RevealedKey(Record):
    """Contents of `seed_key.json`: the key of a run with held-back seeds, disclosed by its publisher."""

    format: Literal[1] = FORMAT
    key: str
    """64 hexadecimal digits."""


def seed_key_file(folder: RunFolder) -> Path:
    """Path of the file in which a run folder discloses the key of its seeds."""
    return folder.path / "seed_key.json"


def read_seed_key(file: Path, option: str = "--seed-key") -> SeedKey:
    """Read the key in a file that an option names.

    Raises:
        UsageError: The file cannot be read, or contains no key.
    """
    try:
        return SeedKey.parse(file.read_text(encoding="ascii"))
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        if isinstance(error, UnicodeDecodeError):
            reason = "it must hold 64 hexadecimal digits and nothing else"
        raise UsageError(f"{option} {file}: {reason} (`openssl rand -hex 32` makes such a key)") from error


def seeds_of(folder: RunFolder, key_file: Path | None) -> SeedOf:
    """Return the function that maps the recorded seeds of a stored run to the seeds of its variants.

    Args:
        folder: The run. Without `run.json`, its recorded seeds are the real ones.
        key_file: File with the key of the run's held-back seeds; None to use the key that the folder discloses.

    Raises:
        UsageError: The run needs a key and there is none, or the key is that of another run.
    """
    # Runs of other programs may lack run.json; their seeds are plain.
    commitment = folder.read_run().plan.held_back if folder.run_file.exists() else ""
    if not commitment:
        if key_file is not None:
            raise UsageError(f"--seed-key {key_file}: {folder.path} was not played on held-back seeds")
        return seed_as_recorded
    revealed = read_revealed(folder)
    if key_file is None and revealed is None:
        raise UsageError(
            f"{folder.path} was played on held-back seeds, which are not revealed yet; whoever has their key names it"
            " with --seed-key FILE"
        )
    key = revealed if key_file is None else read_seed_key(key_file)
    assert key is not None
    if key.commitment != commitment:
        source = key_file or seed_key_file(folder)
        raise UsageError(
            f"the key in {source} is not the one that {folder.path} was played with: its commitment is"
            f" {key.commitment[:16]}…, and that of the run {commitment[:16]}…"
        )
    return key.seed


def read_revealed(folder: RunFolder) -> SeedKey | None:
    """Read the seed key that a run folder discloses; None if it discloses none.

    Raises:
        StoreError: `seed_key.json` cannot be read.
    """
    file = seed_key_file(folder)
    if not file.exists():
        return None
    try:
        return SeedKey.parse(RevealedKey.model_validate_json(file.read_bytes()).key)
    except (OSError, ValidationError, ValueError) as error:
        raise StoreError(f"{file} holds no seed key: {reason_of(error)}") from error


def reveal(folder: RunFolder, key_file: Path) -> None:
    """Write the key of the held-back seeds into the run folder, so that everybody can grade and replay the run.

    Raises:
        UsageError: The seeds of the run are not held back, or were drawn with another key.
        StoreError: The file cannot be written.
    """
    seeds_of(folder, key_file)
    disclosed = RevealedKey(key=read_seed_key(key_file).secret.hex())
    folder.write_text(seed_key_file(folder), disclosed.model_dump_json(indent=2) + "\n")


def pass_on_key(source: RunFolder, target: RunFolder) -> None:
    """Copy the disclosed seed key of a run, if there is one, to a run that was made from it."""
    key = read_revealed(source)
    if key is not None:
        target.write_text(seed_key_file(target), RevealedKey(key=key.secret.hex()).model_dump_json(indent=2) + "\n")


def is_withheld(folder: RunFolder) -> bool:
    """Whether the grades of a run must omit the correct answers, because its seeds or worlds are held back."""
    run = folder.read_run()
    if any(world.commitment for world in run.worlds.values()):
        return True
    return bool(run.plan.held_back) and not seed_key_file(folder).exists()


def is_keyed_world(scene: int, scenes_dir: Path | None) -> bool:
    """Whether a scene is a world that was made with a key, according to its record."""
    if not is_world(scene):
        return False
    try:
        return bool(_played(scene, scenes_dir or default_folder()).commitment)
    except UsageError:  # no record: an exported world, whose evidence is not measurable
        return False


def played_worlds(packs: Iterable[PackFiles], scenes_dir: Path | None) -> dict[str, PlayedWorld]:
    """Map the references of the packs that are made from world records to the provenance of their worlds.

    Raises:
        UsageError: The record of a world cannot be read.
    """
    folder = scenes_dir or default_folder()
    kept = [files.scene_id for files in packs if is_world(files.scene_id) and files.folder.parent != folder]
    return {reference_of(scene): _played(scene, folder) for scene in kept}


def refuse_other_worlds(run: RunRecord, scenes_dir: Path | None) -> None:
    """Raise if a world in the folder of packs differs from the one that the run was played in.

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
