"""Selects the variant that a request names by scene and seed, index in a split, or world, and checks its seed."""

import hashlib
import secrets
from dataclasses import replace
from pathlib import Path

import anyio.to_thread

from evaluator.certify.seed_proofs import SeedProver
from evaluator.errors import RefusedRequest, UsageError
from evaluator.records.run import SEED_SHIFT
from evaluator.referee.contract import Variant, WantedEpisode, WantedVariants, WantedWorld
from evaluator.study.selection import find_split
from scenes import WorldError, default_folder, find_pack, reference_of
from scenes.splits import HELD_BACK, Split, splits
from scenes.worlds.folders import levels_of, worlds_of
from scenes.worlds.records import WorldRecord

_EXAMPLES = '{"scene": 7, "seed": 3}, {"split": "train", "index": 0} or {"split": "train", "random_seed": 5}'
_WORLD_EXAMPLES = '{"world": {"level": 5}}, {"world": {"level": 5}, "split": "train", "index": 0}'


def variant_of(wanted: WantedEpisode, *, held_back: bool, folder: Path | None = None) -> Variant:
    """Return the variant that a request selects.

    A split with N scenes is numbered by `index`: scene number `index % N` in ascending order, at seed number
    `index // N`. The first N indexes are therefore all scenes at the first seed. A `random_seed` selects uniformly
    among all indexes, or among those of `scene` if the request names one. Worlds are numbered in the same way; a
    request for a world without `index` and `random_seed` gets a random one.

    Args:
        wanted: The request.
        held_back: Whether the referee has a seed key, so that all its seeds are held back.
        folder: Folder of packs and worlds; the suite by default.

    Raises:
        RefusedRequest: The request names no variant, more than one, or one outside the split.
    """
    if wanted.world is not None:
        return _world(wanted, wanted.world, held_back, folder or default_folder())
    if wanted.split is None:
        if wanted.index is not None or wanted.random_seed is not None:
            raise RefusedRequest(
                400, f"index and random_seed are places in a split, which is missing: send {_EXAMPLES}"
            )
        if wanted.scene is None:
            raise RefusedRequest(400, f"the request names no variant: send {_EXAMPLES}")
        return Variant(wanted.scene, wanted.seed or 0)
    split = _split(wanted.split, held_back=held_back)
    if wanted.scene is not None and wanted.scene not in split.scenes:
        raise RefusedRequest(404, f"scene {reference_of(wanted.scene)} is not in the split {split.label}")
    if [wanted.index, wanted.random_seed, wanted.seed].count(None) != 2 or (
        wanted.seed is not None and wanted.scene is None
    ):
        raise RefusedRequest(
            400, 'in a split, name one of index, random_seed, and seed with its scene: send {"split": …, "index": 0}'
        )
    return _placed(split, _index(split, wanted), wanted.scene)


def next_variant(variant: Variant) -> Variant:
    """Return the variant of the same scene at the next seed of its split. The variant must have an index.

    Raises:
        RefusedRequest: It was the last seed of the split.
    """
    assert variant.index is not None
    split = _split(variant.split, held_back=variant.split.partition("@")[0] == HELD_BACK)
    return replace(_placed(split, variant.index + len(split.scenes), variant.scene), step=variant.step)


def _world(wanted: WantedEpisode, world: WantedWorld, held_back: bool, folder: Path) -> Variant:
    """Return the variant of a world that a request selects, including the seed of its noise."""
    if wanted.scene is not None or wanted.seed is not None or None not in {wanted.index, wanted.random_seed}:
        raise RefusedRequest(400, f"of a world, name one of index and random_seed, or neither: send {_WORLD_EXAMPLES}")
    pool = _worlds(world, wanted.split, folder, held_back=held_back)
    if wanted.index is None and wanted.random_seed is None:
        wanted = wanted.model_copy(update={"random_seed": secrets.randbits(64)})
    place = _placed(pool, _index(pool, wanted), None)
    return place if wanted.split else replace(place, split="")


def pool_of(wanted: WantedVariants, *, held_back: bool, folder: Path | None = None) -> Split:
    """Return the scenes and seeds among which a request of `GET /variants` selects.

    Args:
        wanted: The request.
        held_back: As for `variant_of`.
        folder: As for `variant_of`.

    Raises:
        RefusedRequest: There is no such split, or no such world.
    """
    asked = wanted.model_dump(include=set(WantedWorld.model_fields))
    world = WantedWorld.model_validate(asked)
    if world != WantedWorld():
        return _worlds(world, wanted.split, folder or default_folder(), held_back=held_back)
    if wanted.split is None:
        raise RefusedRequest(400, "name a split or a level of worlds: GET /variants?split=train or ?level=5")
    return _split(wanted.split, held_back=held_back)


def curriculum_pool(wanted: WantedEpisode, *, held_back: bool, folder: Path | None = None) -> Split:
    """Return the scenes and seeds of a request that draws from a curriculum.

    Args:
        wanted: The request.
        held_back: As for `variant_of`.
        folder: As for `variant_of`.

    Raises:
        RefusedRequest: The request names a single variant, no split and no worlds, or one that does not exist.
    """
    if (wanted.scene, wanted.seed, wanted.index) != (None, None, None):
        raise RefusedRequest(400, 'a curriculum draws the variant: send {"curriculum": "mine", "split": "train"}')
    if wanted.world is not None:
        return _worlds(wanted.world, wanted.split, folder or default_folder(), held_back=held_back)
    return pool_of(WantedVariants(split=wanted.split), held_back=held_back)


def _worlds(world: WantedWorld, split: str | None, folder: Path, *, held_back: bool) -> Split:
    """Return the worlds of a folder that match a request, as a split whose seeds determine the noise."""
    if held_back:
        raise RefusedRequest(409, "this referee was started with --seed-key, and that opens no worlds: start another")
    named = None if split is None else _split_of_worlds(split)
    try:
        levels = levels_of(folder) if world.level is None else [world.level]
        found = [record for level in levels for record in worlds_of(folder, level)]
    except WorldError as error:
        raise RefusedRequest(404, str(error)) from error
    found = [record for record in found if _fits(record, world) and (named is None or record.split == named.name)]
    if not found:
        asked = ", ".join(f"{name} {value}" for name, value in world.model_dump(exclude_none=True).items())
        where = f" in the split {split}" if named else ""
        raise RefusedRequest(
            404, f"no world here has {asked or 'a law'}{where}; `physment-eval worlds make` makes some"
        )
    pool = Split("worlds", tuple(record.scene_id for record in found), range(SEED_SHIFT), found[0].grammar)
    return replace(pool, name=named.name, seeds=named.seeds, version=named.version) if named else pool


def _split_of_worlds(name: str) -> Split:
    """Find a split of worlds by name; `held-back` contains the worlds of a seed key."""
    if name == HELD_BACK:
        return Split(HELD_BACK, (), range(SEED_SHIFT), splits()["test"].version)
    found = _split(name, held_back=False)
    if found.name not in {"train", "validation", "test"}:
        raise RefusedRequest(404, f"the split {name} has no worlds; train, validation, test and {HELD_BACK} have")
    return found


def _fits(record: WorldRecord, world: WantedWorld) -> bool:
    has = {
        "level": record.level,
        "terms": len(record.terms),
        "modulations": sum(len(names) for _, names in record.terms),
        "hidden": len(record.structure.hidden),
        "apparatus": str(record.apparatus),
    }
    return world.model_dump(exclude_none=True).items() <= has.items()


def _split(name: str, *, held_back: bool) -> Split:
    """Find a split by name, with or without its version."""
    plain = name.partition("@")[0]
    if held_back:
        if plain != HELD_BACK:
            raise RefusedRequest(
                409,
                f"this referee was started with --seed-key, so all its variants are those of {HELD_BACK}, and not of"
                f" {name}: ask for that, or start another referee",
            )
        split = replace(splits()["test"], name=HELD_BACK, seeds=range(SEED_SHIFT))
    elif plain == HELD_BACK:
        raise RefusedRequest(
            404, f"the seeds of {HELD_BACK} come from a key that its publisher keeps: start the referee with --seed-key"
        )
    else:
        try:
            split = find_split(plain)
        except UsageError as error:
            raise RefusedRequest(404, str(error)) from error
    if name not in {plain, split.label}:
        raise RefusedRequest(404, f"there is no split {name!r} here; this suite has {split.label}")
    return split


def _index(split: Split, wanted: WantedEpisode) -> int:
    """Return the index in the split that a request selects."""
    if wanted.index is not None:
        return wanted.index
    count = len(split.scenes)
    if wanted.seed is not None:
        assert wanted.scene is not None
        if wanted.seed not in split.seeds:
            raise RefusedRequest(
                404, f"seed {wanted.seed} is not in the split {split.label}; it has {split.seeds[0]}-{split.seeds[-1]}"
            )
        return split.scenes.index(wanted.scene) + count * split.seeds.index(wanted.seed)
    # A hash instead of a random generator, so that trainers in every language can select the same variants.
    digest = hashlib.sha256(f"{split.label} {wanted.random_seed}".encode()).digest()
    drawn = int.from_bytes(digest, "big")
    if wanted.scene is None:
        return drawn % (count * len(split.seeds))
    return split.scenes.index(wanted.scene) + count * (drawn % len(split.seeds))


def _placed(split: Split, index: int, scene: int | None) -> Variant:
    """Return the variant at an index of a split.

    Raises:
        RefusedRequest: The index is outside the split, or its scene is not the requested `scene`.
    """
    count = len(split.scenes)
    if index >= count * len(split.seeds):
        raise RefusedRequest(
            404, f"the split {split.label} has {count * len(split.seeds)} variants, so index {index} is not among them"
        )
    found = Variant(split.scenes[index % count], split.seeds[index // count], split.label, index)
    if scene not in {None, found.scene}:
        raise RefusedRequest(400, f"variant {index} of {split.label} is one of scene {found.scene}, not of {scene}")
    return found


async def proved_variant(prover: SeedProver, wanted: WantedEpisode, variant: Variant) -> Variant:
    """Check the seed of a variant and return the variant to open.

    If the seed fails, the next seed of the scene in the split replaces it, unless the request named the seed. A scene
    without a certificate is not checked.

    Args:
        prover: Object that checks seeds.
        wanted: The request.
        variant: The variant that it selects.

    Raises:
        RefusedRequest: The seed fails the checks and must not be replaced, or no other seed is left.
    """
    while await anyio.to_thread.run_sync(prover.needs_proof, variant.scene, variant.seed):
        place = variant.scene, variant.seed
        failed = await prover.prove([(find_pack(variant.scene, prover.scenes_dir), variant.seed)])
        if not failed:
            break
        if wanted.seed is not None or variant.index is None:
            raise RefusedRequest(404, f"{failed[place].sentence(variant.scene)}, so it is not opened")
        variant = next_variant(variant)
    return variant
