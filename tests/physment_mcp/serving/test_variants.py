"""Tests of loading the variants of a scene, which the server compares to find parts that depend on the seed."""

from pathlib import Path

import pytest

from physment_mcp.errors import SceneError
from physment_mcp.scene import load_variants


def test_the_models_of_twenty_seeds_begin_with_the_one_as_written() -> None:
    models = load_variants(7)
    assert len(models) == 20
    assert len(set(models)) > 10


def test_variants_that_cannot_be_read_are_refused_in_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="frames need the seeds 0 to 19 of a scene"):
        load_variants(7, tmp_path)
