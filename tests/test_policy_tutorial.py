"""Tests of the tutorial on a policy: its program runs as shown, and its policy scores higher than random play."""

import re

from tests.harness.policy_tutorial import PAGE, learned, shares

SCENES = (7, 9, 14)


def test_the_program_of_the_page_trains_and_measures_each_scene() -> None:
    trained, limits = learned(2)
    assert set(trained) == set(limits) == set(SCENES)
    assert all(0 <= share <= 1 for share in trained.values())
    assert all(0 < share < 1 for share in limits.values())


def test_every_row_of_the_table_is_above_the_quantile_of_random_play() -> None:
    limits = shares(PAGE, "its 99 % quantile")
    rows = re.findall(r"^\| (\d+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", PAGE, re.MULTILINE)
    assert len(rows) == 5
    assert all(float(share) > limits[scene] for row in rows for scene, share in zip(SCENES, row[1:], strict=True))
