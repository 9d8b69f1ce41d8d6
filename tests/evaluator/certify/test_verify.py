"""Tests that a stored certificate is valid only for a sound, unchanged pack, on the same engine and enough seeds."""

import json
from importlib.metadata import version
from pathlib import Path

import pytest

from evaluator.certify.records import (
    CERTIFICATES,
    CERTIFICATES_FILE,
    FAMILY_CERTIFICATES,
    PREDICTION_CERTIFICATES,
    SceneCertificate,
    certificates_of,
    check,
    engine_note,
    read_certificates,
    still_proven,
    write_certificates,
)
from scenes import Category, PackFiles, pack_hash, read_pack
from tests.builders.author import Author


@pytest.fixture
def files(tmp_path: Path) -> PackFiles:
    return Author(tmp_path).write(Category.HARD_SINGLE)


def proven(files: PackFiles, names: tuple[str, ...], reasons: tuple[str, ...] = ()) -> SceneCertificate:
    return SceneCertificate(
        scene=200,
        name="a cart",
        category="hard-single",
        pack=pack_hash(files),
        seeds=20,
        checks=tuple(check(name, list(reasons)) for name in names),
    )


def test_a_sound_and_unchanged_pack_stays_proven(files: PackFiles) -> None:
    certificate = proven(files, certificates_of(read_pack(files)))
    write_certificates(files.folder.parent, [certificate])
    assert still_proven(files.folder.parent, [files], 20) == [certificate]
    assert still_proven(files.folder.parent, [files], 6) == [certificate]
    assert still_proven(files.folder.parent, [files], 40) == []


def test_fewer_seeds_do_not_replace_a_stronger_certificate_unless_they_find_a_fault(
    files: PackFiles, tmp_path: Path
) -> None:
    names = certificates_of(read_pack(files))
    strong = proven(files, names)
    write_certificates(tmp_path, [strong])
    write_certificates(tmp_path, [proven(files, names).model_copy(update={"seeds": 2})])
    assert still_proven(tmp_path, [files], 20) == [strong]
    write_certificates(tmp_path, [proven(files, names, ("it gains energy",)).model_copy(update={"seeds": 2})])
    assert still_proven(tmp_path, [files], 2) == []


def test_a_changed_pack_gets_the_certificate_on_fewer_seeds(files: PackFiles, tmp_path: Path) -> None:
    names = certificates_of(read_pack(files))
    write_certificates(tmp_path, [proven(files, names)])
    Author(tmp_path).edit(files, lambda pack: pack.update(version="2"))
    weaker = proven(files, names).model_copy(update={"seeds": 2})
    write_certificates(tmp_path, [weaker])
    assert still_proven(tmp_path, [files], 2) == [weaker]


def test_a_changed_pack_is_proven_again(files: PackFiles, tmp_path: Path) -> None:
    write_certificates(tmp_path, [proven(files, certificates_of(read_pack(files)))])
    Author(tmp_path).edit(files, lambda pack: pack.update(version="2"))
    assert still_proven(tmp_path, [files], 20) == []


def test_a_pack_that_was_not_sound_or_lacks_a_certificate_is_proven_again(files: PackFiles, tmp_path: Path) -> None:
    write_certificates(tmp_path, [proven(files, certificates_of(read_pack(files)), ("it gains energy",))])
    assert still_proven(tmp_path, [files], 20) == []
    write_certificates(tmp_path, [proven(files, CERTIFICATES)])
    assert still_proven(tmp_path, [files], 20) == []


def test_certificates_of_another_engine_do_not_count(files: PackFiles, tmp_path: Path) -> None:
    stored = write_certificates(tmp_path, [proven(files, certificates_of(read_pack(files)))])
    record = json.loads(stored.read_text(encoding="utf-8"))
    stored.write_text(json.dumps(record | {"engine": "0.1"}), encoding="utf-8")
    assert still_proven(tmp_path, [files], 20) == []


def test_proving_on_another_engine_leaves_the_first_engines_certificates_as_they_are(
    files: PackFiles, tmp_path: Path
) -> None:
    certificate, engine = proven(files, certificates_of(read_pack(files))), version("mujoco")
    first = write_certificates(tmp_path, [certificate])
    assert engine_note(tmp_path) == ""
    of_another = first.read_text(encoding="utf-8").replace(engine, "0.1")
    first.write_text(of_another, encoding="utf-8")
    assert f"hold on MuJoCo 0.1, but {engine} is installed" in engine_note(tmp_path)
    second = write_certificates(tmp_path, [certificate])
    assert (second.name, first.read_text(encoding="utf-8")) == (f"certificates-{engine}.json", of_another)
    assert still_proven(tmp_path, [files], 20) == [certificate]
    assert engine_note(tmp_path) == ""
    assert [found.engine for found in (read_certificates(tmp_path), read_certificates(tmp_path, engine)) if found] == [
        "0.1", engine,
    ]  # fmt: skip


def test_only_packs_that_ask_for_a_prediction_within_limits_need_the_further_certificates(tmp_path: Path) -> None:
    author = Author(tmp_path)
    files = author.write(Category.HARD_SINGLE)
    assert certificates_of(read_pack(files)) == CERTIFICATES + PREDICTION_CERTIFICATES + FAMILY_CERTIFICATES
    author.edit(files, lambda pack: pack.pop("family"))
    assert certificates_of(read_pack(files)) == CERTIFICATES + PREDICTION_CERTIFICATES
    author.edit(files, lambda pack: pack.pop("limits"))
    assert certificates_of(read_pack(files)) == CERTIFICATES
    author.edit(files, lambda pack: pack.update(category="easy-single", limits={"calls": 9}))
    assert certificates_of(read_pack(files)) == CERTIFICATES


def test_half_a_file_is_never_left(files: PackFiles, tmp_path: Path) -> None:
    write_certificates(tmp_path, [proven(files, CERTIFICATES)])
    assert [file.name for file in tmp_path.iterdir() if file.is_file()] == [CERTIFICATES_FILE]
