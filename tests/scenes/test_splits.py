"""Tests of the suite's splits: complete, disjoint and unchanged."""

import hashlib
import re
from itertools import combinations

import pytest

from scenes import Rung, list_packs, read_pack
from scenes.splits import splits
from tests.builders.paths import DOCS

FINGERPRINTS = {1: "4aa1ac557dad1ca3"}
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


def test_a_trainer_gets_the_lists_that_the_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    page = (DOCS / "how-to" / "splits.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    exec(compile(program, "splits.md", "exec"), {})
    assert capsys.readouterr().out.splitlines() == re.findall(r"# → (.+)$", program, re.MULTILINE)
    for name, parts in splits().items():
        row = next(line for line in page.splitlines() if line.startswith(f"| `{name}` |"))
        assert f"| {parts.seeds[0]}-{parts.seeds[-1]} |" in row
        assert name not in {"train", "test-ideas", "test-categories", "test"} or f"{len(parts.scenes)}" in row


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
