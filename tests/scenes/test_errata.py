"""Tests that errata of a folder of packs are read, or refused in one sentence."""

import datetime as dt
import json
from pathlib import Path
from typing import Any

import pytest

from scenes import ErratumEffect, PackError, default_folder, read_errata

ENTRY: dict[str, Any] = {
    "scene": 7,
    "pack": "c1:0123456789ab",
    "effect": "withdrawn",
    "fault": "The key is that of another spring.",
    "date": "2026-11-26",
}


def write(folder: Path, *entries: object) -> Path:
    """Write the errata of a folder of packs."""
    (folder / "errata.json").write_text(json.dumps(entries), encoding="utf-8")
    return folder


def test_a_folder_without_the_file_has_no_errata(tmp_path: Path) -> None:
    assert read_errata(tmp_path) == ()


def test_an_entry_is_read(tmp_path: Path) -> None:
    (entry,) = read_errata(write(tmp_path, ENTRY))
    assert (entry.scene, entry.effect, entry.date) == (7, ErratumEffect.WITHDRAWN, dt.date(2026, 11, 26))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("scene", -1),
        ("pack", "0123456789ab"),
        ("effect", "doubted"),
        ("fault", "no full stop"),
        ("fault", "Two lines.\nOf text."),
        ("date", "yesterday"),
        ("seed", 3),
    ],
)
def test_a_malformed_entry_is_refused_with_the_name_of_its_field(field: str, value: object, tmp_path: Path) -> None:
    with pytest.raises(PackError, match=rf"errata\.json: entry 1\.{field}: "):
        read_errata(write(tmp_path, ENTRY, ENTRY | {"pack": "c1:ba9876543210", field: value}))


@pytest.mark.parametrize("text", ["{", "{}", '[{"scene": 7}]', "[1]"])
def test_a_file_of_another_form_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "errata.json").write_text(text, encoding="utf-8")
    with pytest.raises(PackError):
        read_errata(tmp_path)


def test_a_pack_has_one_entry(tmp_path: Path) -> None:
    with pytest.raises(PackError, match="several entries"):
        read_errata(write(tmp_path, ENTRY, ENTRY | {"effect": "noted"}))


def test_the_errata_of_the_suite_are_sound() -> None:
    folder = default_folder()
    assert {entry.effect for entry in read_errata(folder)} <= set(ErratumEffect)
    assert all((folder / f"Scene{entry.scene}").is_dir() for entry in read_errata(folder))
