"""Tests of folders of worlds: lookup by reference and split, publishing, and errors."""

import errno
import itertools
import json
import random
import tempfile
import xml.etree.ElementTree as ET
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import physment_mcp
from scenes import default_folder
from scenes.errors import PackError, WorldError
from scenes.finding import find_pack, is_in_split
from scenes.folder import read_pack
from scenes.pack import CANARY
from scenes.public import read_hosted
from scenes.splits import splits
from scenes.world_names import scene_id_of
from scenes.worlds.answering import answers
from scenes.worlds.drawing import SPLITS, draw_structure, structures_of
from scenes.worlds.expansion import world_ids
from scenes.worlds.folders import PUBLISHED, find_certificate, find_record, find_worlds, levels_of, worlds_of
from scenes.worlds.levels import LEVELS, difficulty_of
from scenes.worlds.orders import PUBLIC, WorldOrder
from scenes.worlds.publishing import publish
from scenes.worlds.records import CANARY_LINE, as_line, keys_file, lines_file, read_certificates, read_records
from tests.builders.paths import DOCS
from tests.builders.worlds import structure_rows, write_worlds

KEY = "5a" * 32


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three worlds of level 1, two of which have adjacent indexes."""
    return write_worlds(tmp_path_factory.mktemp("worlds"), (0, 1, 6))


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_references_name_the_worlds_that_are_there(worlds: Path) -> None:
    assert world_ids("world:1", worlds) == [scene_id_of(1, index) for index in (0, 1, 6)]
    assert world_ids("world:1:0-1", worlds) == [scene_id_of(1, 0), scene_id_of(1, 1)]
    assert find_worlds("world:1:6", worlds) == [find_record(1, 6, worlds)]
    assert levels_of(worlds) == [1]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("world:1:5", "there is no world:1:5; level 1 has 3 worlds here"),
        ("world:1:0-9", "there is no world:1:2"),
        ("world:2", "there are no worlds of level 2 here"),
        ("world:0", "there is no level 0; levels are 1 to 10"),
        ("world:11:0", "there is no level 11"),
        ("world:1-", "names no worlds"),
    ],
)
def test_a_world_that_is_not_there_is_said(worlds: Path, text: str, sentence: str) -> None:
    with pytest.raises(PackError, match=sentence):
        world_ids(text, worlds)


def test_a_scene_id_of_no_world_is_refused_as_others_are(worlds: Path) -> None:
    with pytest.raises(PackError, match="there is no world:1:77"):
        find_pack(scene_id_of(1, 77), worlds)
    with pytest.raises(PackError, match="there is no level 899"):
        find_pack(scene_id_of(899, 0), worlds)


def test_a_world_is_in_the_split_of_its_structure(worlds: Path) -> None:
    found = {name: is_in_split(scene_id_of(1, 6), split, worlds) for name, split in splits().items()}
    assert [name for name, inside in found.items() if inside] == ["validation"]


def test_another_seed_is_the_same_world_with_other_noise(worlds: Path) -> None:
    files = find_pack(scene_id_of(1, 0), worlds)
    publics, models = zip(*(read_hosted(files, seed) for seed in (0, 1, 1, 2)), strict=True)
    assert len(set(map(str, publics))) == 1
    assert models[1] == models[2]
    assert len(set(models)) == 3
    salts = [model.split('name="noise_salt" data="')[1].split('"')[0] for model in models]
    assert len({ET.canonicalize(model.replace(salt, "")) for model, salt in zip(models, salts, strict=True)}) == 1
    readings = [
        physment_mcp.open_episode(files.scene_id, seed, scenes_dir=worlds).call("get_velocity", object_id="object_1")
        for seed in (0, 1)
    ]
    assert readings[0] != readings[1]


def test_a_torn_cache_is_written_again(worlds: Path, cache: Path) -> None:
    files = find_pack(scene_id_of(1, 0), worlds)
    assert files.folder.is_relative_to(cache)
    whole = {path: path.read_bytes() for path in files.folder.iterdir()}
    for path, content in whole.items():
        path.write_bytes(content[: len(content) // 2])
    files.mjcf.unlink()
    assert find_pack(scene_id_of(1, 0), worlds) == files
    assert {path: path.read_bytes() for path in files.folder.iterdir()} == whole


def test_a_full_disk_is_said_and_leaves_nothing(worlds: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(tempfile, "mkstemp", full)
        with pytest.raises(PackError, match="cannot keep the packs of worlds: No space left on device"):
            find_pack(scene_id_of(1, 0), worlds)
    assert not [path for path in cache.rglob("*") if path.is_file()]
    assert read_pack(find_pack(scene_id_of(1, 0), worlds)).answer


def test_many_may_expand_a_world_at_once(worlds: Path) -> None:
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda _: find_pack(scene_id_of(1, 1), worlds), range(40)))
    assert len(set(found)) == 1
    assert len(list(found[0].folder.iterdir())) == 3
    assert read_pack(found[0]).answer


def test_an_unfinished_line_is_no_world_and_a_damaged_one_is_named(worlds: Path, tmp_path: Path) -> None:
    lines = lines_file(worlds, 1).read_text(encoding="utf-8").splitlines()
    torn = tmp_path / "torn"
    torn.mkdir()
    lines_file(torn, 1).write_text(f"{lines[0]}\n{lines[1][:40]}", encoding="utf-8")
    assert [record.index for record in read_records(torn, 1)] == [0]
    lines_file(torn, 1).write_text(f"{lines[0][:-9]}\n{lines[1]}\n", encoding="utf-8")
    with pytest.raises(WorldError, match=r"level-1\.jsonl, line 1"):
        list(read_records(torn, 1))
    newer = json.dumps(json.loads(lines[0]) | {"grammar": 99})
    lines_file(torn, 1).write_text(newer + "\n", encoding="utf-8")
    with pytest.raises(PackError, match="line 1: grammar: Input should be less than or equal to"):
        find_pack(scene_id_of(1, 0), torn)


def test_a_published_set_has_its_keys_apart_and_the_canary(worlds: Path, tmp_path: Path) -> None:
    target = tmp_path / "set"
    sizes = publish(worlds, target, 2)
    assert sorted(sizes) == ["keys/level-1.keys.jsonl", "level-1.jsonl"]
    for name in sizes:
        first = (target / name).read_text(encoding="utf-8").splitlines()[0]
        assert json.loads(first) == {"canary": CANARY}
    assert [one.index for one in read_certificates(target, 1)] == [0, 1]
    key = next(iter(read_certificates(target, 1))).key
    assert read_pack(find_pack(scene_id_of(1, 0), target)).answer == key
    keys_file(target, 1).rename(tmp_path / "kept")
    hosted = find_pack(scene_id_of(1, 0), target)
    assert {path.suffix for path in hosted.folder.iterdir()} == {".json", ".xml"}
    assert "answer" not in json.loads(next(hosted.folder.glob("*.json")).read_text(encoding="utf-8"))


def test_the_public_set_has_no_gaps() -> None:
    folder = default_folder()
    assert list(levels_of(folder)) == [*LEVELS]
    for level in levels_of(folder):
        assert lines_file(folder / PUBLISHED, level).read_text(encoding="utf-8").startswith(CANARY_LINE)
        for index, record in enumerate(worlds_of(folder, level)):
            certificate = find_certificate(record, folder)
            assert certificate is not None
            assert (record.index, record.settings, record.commitment) == (index, (), "")
            assert certificate.record == record.digest


FURTHER = [pytest.param(first, marks=pytest.mark.extended) for first in range(20, 100, 10)]


@pytest.mark.parametrize("first", [0, 10, *FURTHER])
def test_theory_gives_the_keys_of_the_public_set(first: int) -> None:
    folder = default_folder()
    for level in levels_of(folder):
        for record in itertools.islice(worlds_of(folder, level), first, first + 10):
            certificate = find_certificate(record, folder)
            assert certificate is not None
            key = answers(record.structure, record.constants, record.questions, 0.01)[:, 0]
            assert key == pytest.approx(certificate.key, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize(
    ("secret", "attributes", "sentence"),
    [
        (PUBLIC, {}, "has no world:1:1, and a published set has no gaps"),
        (KEY, {}, "world:1:0 was drawn with a key, so it is held back"),
        (PUBLIC, {"looks": 40}, "world:1:0 was made with looks=40, and not with the settings of its level"),
    ],
)
def test_what_is_not_to_be_published_is_refused(
    secret: str, attributes: dict[str, object], sentence: str, tmp_path: Path
) -> None:
    folder = write_worlds(tmp_path / "worlds", (0,), secret, **attributes)
    with pytest.raises(WorldError, match=sentence):
        publish(folder, tmp_path / "set", 2)
    assert not (tmp_path / "set").exists()


def test_a_set_with_a_strange_certificate_is_not_published(worlds: Path, tmp_path: Path) -> None:
    folder = write_worlds(tmp_path / "worlds")
    one = next(iter(read_certificates(folder, 1))).model_copy(update={"record": "other"})
    keys_file(folder, 1).write_text(as_line(one) + "\n", encoding="utf-8")
    with pytest.raises(WorldError, match="has no certificate of its own"):
        publish(folder, tmp_path / "set", 1)
    with pytest.raises(WorldError, match="is not empty"):
        publish(worlds, folder, 1)


@pytest.mark.parametrize("level", [1, 2, 3])
def test_the_structures_of_a_level_are_counted_and_each_split_has_some(level: int) -> None:
    counted = structures_of(difficulty_of(level))
    assert all(counted.values())
    if level < 3:
        rng = random.Random(level)
        drawn = {draw_structure(difficulty_of(level), rng).label for _ in range(6_000)}
        assert len(drawn) == sum(counted.values())


def test_the_page_states_the_structures_of_each_level(update_goldens: bool) -> None:
    page = DOCS / "explanation" / "worlds.md"
    text = page.read_text(encoding="utf-8")
    rest = text.partition(
        "| level | structures | train | validation | test | held-back |\n|---|---|---|---|---|---|\n"
    )[2]
    stated, _, after = rest.partition("\n\n")
    if update_goldens:
        stated = "\n".join(structure_rows(LEVELS))
        page.write_text(text[: len(text) - len(rest)] + stated + "\n\n" + after, encoding="utf-8")
    assert len(stated.splitlines()) == len(LEVELS)
    assert stated.splitlines()[:6] == structure_rows(LEVELS[:6])  # higher levels take seconds each


def test_the_count_agrees_with_draws_of_modulations() -> None:
    difficulty = difficulty_of(1).changed(terms=1, modulations=2)
    rng, counted = random.Random(4), structures_of(difficulty)
    for split, _ in SPLITS:
        drawn = {draw_structure(difficulty, rng, split).label for _ in range(30 * counted[split])}
        assert len(drawn) == counted[split]


@pytest.mark.parametrize("level", LEVELS)
def test_a_level_has_no_settings_of_its_own(level: int) -> None:
    assert WorldOrder(level, difficulty_of(level), PUBLIC).settings == ()


def test_settings_are_as_the_command_line_takes_them() -> None:
    settings = ("kinds=strong,late", "looks=44", "noise=0.0123")
    order = WorldOrder(3, difficulty_of(3).changed_by(settings), KEY)
    assert order.settings == settings
    assert difficulty_of(3).changed_by(order.settings) == order.difficulty
    assert len(order.commitment) == 64
    assert KEY not in order.commitment
    assert order.indexes(3) == [0, 1, 2]


def test_indexes_of_a_split() -> None:
    order = WorldOrder(1, difficulty_of(1), PUBLIC)
    assert order.indexes(4, "validation") == [6, 7, 16, 17]
    assert order.indexes(2, first=100) == [100, 101]
    with pytest.raises(WorldError, match="a level has 20000 such worlds from 0 on, not 20001"):
        order.indexes(20_001, "test")
    with pytest.raises(WorldError, match="the worlds of a key are those of the split held-back"):
        order.indexes(1, "held-back")
