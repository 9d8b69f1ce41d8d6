"""Tests of the public names of `scenes`."""

import scenes
from tests.builders.public_names import check_public_names


def test_the_public_names_are_sorted_documented_and_importable() -> None:
    check_public_names(scenes)
