"""Verifies variants at seeds that no certificate covers, by the certificate checks that apply to a single seed.

A variant is proved if theory and engine agree on its key and the reference protocol finds it (certificate `key`), if
its initial readings are those of seed 0 (`twins`), and if initial contacts are not deep and energy does not increase
(`sane`). Proofs are cached by the hash of the pack and the seed, but failures are not, because they may have another
cause, such as too little memory.
"""

import functools
import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path

import anyio
from pydantic import Field, ValidationError

from evaluator.certify.processes import in_processes
from evaluator.certify.records import Check, check, still_proven
from evaluator.errors import StoreError
from evaluator.records.episode import Record, is_absent
from evaluator.records.run import SeedOf, SeedProofs, seed_as_recorded
from evaluator.store.durable import append_line
from scenes import PackFiles, default_folder, is_world, pack_hash, reference_of


class SeedProof(Record):
    """The result of checking a variant of a scene. The cache holds one on each line."""

    pack: str
    """Hash of the pack."""
    seed: int
    """Seed as recorded; if it is held back, the number of the variant."""
    held_back: str = Field(default="", exclude_if=is_absent)
    """Commitment to the key of held-back seeds; absent if the seed is as recorded."""
    engine: str
    """Version of MuJoCo."""
    physment: str
    """Version of this package, which holds the library of the reference protocols."""
    failed: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Names of the certificates that this seed fails; absent if it is proved."""
    reasons: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Why it fails, one sentence for each reason. Absent for held-back seeds, because a reason may state the key."""

    def sentence(self, scene: int) -> str:
        """Explain in a clause why the seed is not played, without revealing its key."""
        return f"scene {reference_of(scene)}, seed {self.seed} cannot be proved (certificate {', '.join(self.failed)})"


def prove(files: PackFiles, seed: int) -> tuple[Check, ...]:
    """Check one seed of a pack. This executes the pack's `solution.py`.

    Args:
        files: The pack.
        seed: The seed of the variant.
    """
    # Imported here, because it loads the engine and the server, which a run on certified seeds does not need.
    from evaluator.certify.keys import check_key  # noqa: PLC0415
    from evaluator.certify.subject import Subject  # noqa: PLC0415
    from evaluator.certify.twins import readings_at_start, revealing  # noqa: PLC0415
    from evaluator.certify.verify import MemoryConnector, check_sane, play_reference  # noqa: PLC0415

    async def checked() -> tuple[Check, ...]:
        subject, laboratory = Subject.open(files), MemoryConnector(files.folder.parent)
        episode = await play_reference(subject, seed, laboratory)
        first, other = [await readings_at_start(subject, number) for number in (0, seed)]
        return (
            check_key(subject, [episode]),
            check("twins", revealing(first, other, seed)),
            check_sane(subject, [seed], []),
        )

    try:
        return anyio.run(checked)
    except Exception as error:  # noqa: BLE001 - the pack's own code ran; any exception is a reason
        return (check("key", [f"solution.py failed: {error!r}"]),)


Variant = tuple[int, int]
"""Scene id and seed as recorded."""


@dataclass(slots=True)
class SeedProver:
    """Decides whether each seed may be played.

    A seed that the scene's certificate does not cover must first pass the checks.
    """

    packs: Sequence[PackFiles]
    """Packs of the scenes that may be played."""
    scenes_dir: Path | None = None
    """Their folder; None for the suite."""
    seed_of: SeedOf = seed_as_recorded
    held_back: str = ""
    """Commitment to the key of held-back seeds; empty if the seeds are as recorded."""
    skip: bool = False
    """Whether the operator disabled proofs."""
    workers: int = field(default_factory=lambda: os.cpu_count() or 1)
    """Number of processes."""
    _certified: dict[int, int] | None = None
    _known: dict[Variant, SeedProof] = field(default_factory=dict[Variant, SeedProof])
    _read: set[str] = field(default_factory=set[str])
    """Packs whose cached proofs have been read into memory."""
    _left_out: dict[Variant, SeedProof] = field(default_factory=dict[Variant, SeedProof])

    def needs_proof(self, scene: int, seed: int) -> bool:
        """Return whether a seed needs a proof: its scene has a certificate, but the certificate does not cover it."""
        return not self.skip and scene in self._certificates() and not self._is_certified(scene, seed)

    def _is_certified(self, scene: int, seed: int) -> bool:
        return self.seed_of(scene, seed) < self._certificates().get(scene, 0)

    def _certificates(self) -> dict[int, int]:
        """Return, for each certified scene, how many seeds (0, 1, ...) its certificate covers."""
        if self._certified is None:
            folder = self.scenes_dir or default_folder()
            found = still_proven(folder, self.packs, 1)
            self._certified = {certificate.scene: certificate.seeds for certificate in found}
        return self._certified

    async def prove(
        self, variants: Iterable[tuple[PackFiles, int]], on_proof: Callable[[SeedProof], None] = lambda _proof: None
    ) -> dict[Variant, SeedProof]:
        """Prove variants in parallel processes, unless the cache has their proofs.

        Args:
            variants: Packs of certified scenes, each with a seed as recorded.
            on_proof: Called with each proof when it is ready.

        Returns:
            The proofs that failed.
        """
        wanted = {(files.scene_id, seed): files for files, seed in variants}
        for files in wanted.values():
            self._read_cache(files)
        todo = [(files, seed) for (scene, seed), files in wanted.items() if (scene, seed) not in self._known]

        def done(job: tuple[PackFiles, int], checks: tuple[Check, ...]) -> None:
            files, seed = job
            self._known[files.scene_id, seed] = proof = self._proof(files, seed, checks)
            if not proof.failed:
                with suppress(StoreError):  # without a cache the next start proves again
                    append_line(_cache_file(proof.pack), proof.model_dump_json().encode())
            on_proof(proof)

        for variant in wanted.keys() & self._known.keys():
            on_proof(self._known[variant])
        await in_processes(todo, self._job, self.workers, done)
        failed = {variant: self._known[variant] for variant in wanted if self._known[variant].failed}
        self._left_out |= failed
        return failed

    def _job(self, job: tuple[PackFiles, int]) -> Callable[[], tuple[Check, ...]]:
        files, seed = job
        return functools.partial(prove, files, self.seed_of(files.scene_id, seed))

    def _proof(self, files: PackFiles, seed: int, checks: Sequence[Check]) -> SeedProof:
        return SeedProof(
            pack=pack_hash(files),
            seed=seed,
            held_back=self.held_back,
            engine=version("mujoco"),
            physment=version("physment-mcp"),
            failed=tuple(one.name for one in checks if not one.passed),
            reasons=() if self.held_back else tuple(reason for one in checks for reason in one.reasons),
        )

    def _read_cache(self, files: PackFiles) -> None:
        """Read the cached proofs of a pack that were made by this version, on this engine and for these seeds."""
        pack = pack_hash(files)
        if pack in self._read:
            return
        self._read.add(pack)
        try:
            lines = _cache_file(pack).read_bytes().splitlines()
        except (OSError, StoreError):
            return
        alike = self._proof(files, 0, ())
        for line in lines:
            with suppress(ValidationError):  # an unfinished last line
                proof = SeedProof.model_validate_json(line)
                if proof.model_copy(update={"seed": 0, "failed": (), "reasons": ()}) == alike:
                    self._known[files.scene_id, proof.seed] = proof

    def record(self, played: Iterable[Variant]) -> SeedProofs:
        """Return which of the played variants were checked, for the record of a run."""
        proved, unproved = dict[str, tuple[int, ...]](), dict[str, tuple[int, ...]]()
        for scene, seed in sorted(set(played)):
            if not is_world(scene) and not self._is_certified(scene, seed):
                kind = proved if self.needs_proof(scene, seed) else unproved
                kind[str(scene)] = (*kind.get(str(scene), ()), seed)
        left_out: dict[str, dict[int, str]] = {}
        for (scene, seed), proof in sorted(self._left_out.items()):
            left_out.setdefault(str(scene), {})[seed] = ", ".join(proof.failed)
        return SeedProofs(proved=proved, unproved=unproved, left_out=left_out)


def _cache_file(pack: str) -> Path:
    """File of the cached proofs of a pack. Source: the XDG Base Directory Specification.

    Raises:
        StoreError: Its folder cannot be made.
    """
    home = os.environ.get("XDG_CACHE_HOME")
    folder = (Path(home) if home else Path.home() / ".cache") / "physment" / "seed-proofs"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)  # a reason may state a key
    except OSError as error:
        raise StoreError(f"{folder} cannot be made: {error.strerror}") from error
    return folder / f"{pack.replace(':', '-')}.jsonl"
