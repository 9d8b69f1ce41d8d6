"""Tests of the tutorials on policies: the programs run as shown, and the policies score higher than random play."""

import re

import pytest

from tests.harness.policy_tutorial import NETWORK, POLICY, learned, shares

SCENES = (7, 9, 14)
TRAINED, HELD_OUT = (7, 9, 10, 11, 12, 64), 60


def test_the_program_of_the_page_trains_and_measures_each_scene() -> None:
    trained, limits = learned(POLICY, 2)
    assert set(trained) == set(limits) == set(SCENES)
    assert all(0 <= share <= 1 for share in trained.values())
    assert all(0 < share < 1 for share in limits.values())


def test_every_row_of_the_table_is_above_the_quantile_of_random_play() -> None:
    limits = shares(POLICY, "its 99 % quantile")
    rows = re.findall(r"^\| (\d+) \| ([\d.]+) \| ([\d.]+) \| ([\d.]+) \|$", POLICY, re.MULTILINE)
    assert len(rows) == 5
    assert all(float(share) > limits[scene] for row in rows for scene, share in zip(SCENES, row[1:], strict=True))


@pytest.mark.extended
def test_a_tenth_of_the_training_of_the_network_beats_the_quantile_of_random_play() -> None:
    trained, limits = learned(NETWORK, 60, "--variants", "30")
    assert set(trained) == set(limits) == {*TRAINED, HELD_OUT}
    assert sum(trained[scene] for scene in TRAINED) / len(TRAINED) > max(limits.values())


def test_the_table_of_the_network_is_above_the_quantile_of_random_play_as_often_as_the_page_says() -> None:
    limits = shares(NETWORK, "its 99 % quantile")
    rows = re.findall(r"^\| (\d+) " + r"\| ([\d.]+) " * 7 + r"\|$", NETWORK, re.MULTILINE)
    assert len(rows) == 5
    found = [dict(zip((*TRAINED, HELD_OUT), map(float, row[1:]), strict=True)) for row in rows]
    assert sum(row[scene] > limits[scene] for row in found for scene in TRAINED) == 29
    assert all(sum(row[scene] for scene in TRAINED) / len(TRAINED) > max(limits.values()) for row in found)
    assert all(row[HELD_OUT] <= limits[HELD_OUT] for row in found)
