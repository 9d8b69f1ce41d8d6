"""The splits of the suite: complete, apart from each other, and fixed."""

import hashlib
from itertools import combinations

from scenes import Rung, list_packs, read_pack
from scenes.splits import splits

FINGERPRINTS = {1: "8226809385048093"}
"""Version of the list → hash of its splits. A published version never changes: a change needs a new version."""


def test_a_published_list_is_never_changed() -> None:
    parts = [f"{split.label} {split.scenes} {split.seeds}" for split in splits().values()]
    version = next(iter(splits().values())).version
    assert hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16] == FINGERPRINTS[version]


def test_every_scene_of_the_suite_is_tested_and_none_is_listed_twice() -> None:
    packs = {files.scene_id: read_pack(files).category for files in list_packs()}
    suite = {scene for scene, category in packs.items() if category and category.rung is not Rung.OPEN}
    assert set(splits()["test"].scenes) == suite
    for split in splits().values():
        assert len(set(split.scenes)) == len(split.scenes)
        assert set(split.scenes) <= set(packs)
    assert not set(splits()["test-open"].scenes) & suite


def test_no_two_roles_share_a_seed() -> None:
    ranges = {splits()[name].seeds for name in ("train", "validation", "test")}
    assert len(ranges) == 3
    assert not any(set(first) & set(second) for first, second in combinations(ranges, 2))


def test_held_out_ideas_and_categories_are_in_no_split_that_is_trained_on() -> None:
    categories = {files.scene_id: read_pack(files).category for files in list_packs()}
    seen = set(splits()["train"].scenes) | set(splits()["validation"].scenes)
    held_out = set(splits()["test-categories"].scenes)
    assert not seen & (held_out | set(splits()["test-ideas"].scenes) | set(splits()["test-open"].scenes))
    assert not {categories[scene] for scene in seen} & {categories[scene] for scene in held_out}
    assert set(splits()["train"].scenes) < set(splits()["validation"].scenes)
