"""Tests the reference agent at seeds at which an earlier version of it was wrong."""

import pytest

from scenes import find_pack
from tests.harness.fresh_seeds import verdict

CASES = [
    (26, 4176143356, "the guard gripped a cart that coasted slower than planned"),
    (28, 1831608469, "a second cord was presumed where there is none, and the latch held the glider"),
    (33, 343401748, "a reading that fell short made the push off the pad too strong"),
    (44, 4003639905, "the float gained speed on a long way, and sank into the trap"),
    (48, 395233773, "the fit ignored the ranges that the task states"),
    (76, 2165984442, "the second cart moved too slowly to tell the size of its resistance"),
    (76, 3306113100, "the second cart moved too slowly to tell the kind of its resistance"),
    (81, 378326033, "one side was presumed as stiff as the other, and the pawl caught the crate"),
    (97, 4205994631, "a force grew fivefold at once, and the line that swung was parted"),
    (100, 3881588331, "a yielding dashpot carried a knob into its latch"),
    (100, 78930479, "the forces hardly exceeded the one from which a dashpot yields"),
    (105, 2036144970, "a pan swung under a new ball, and its stiff thread broke"),
    (107, 2161080772, "the fit omitted the inertia of pan and load, at 74 N"),
    (107, 3766720252, "the fit omitted the inertia of pan and load, at 125 N"),
    (201, 850610864, "a puck on one side of the floor determined a long wave too weakly"),
    (212, 1924654402, "a wrong mass led the puck into the rim"),
    (215, 3031066160, "the fit of a wave ended in a local minimum"),
    (215, 2000933834, "a wrong mass led the puck on waves into the rim"),
    (216, 524623619, "a wrong estimate of the motion led the puck into the rim"),
    (216, 594015080, "the puck was led too slowly to distinguish two structures"),
    (219, 166530120, "a wrong mass sent the puck on a leash into the rim"),
    (219, 364440126, "the readings determined the force of a leash with a grip too weakly"),
    (219, 3552809915, "the readings determined the force of another leash too weakly"),
]
"""Scene, seed, and why the earlier version was wrong."""
QUICK = (48, 215)
"""Scenes whose episodes take less than 3 s of processor time; the others take up to 20 s."""


@pytest.mark.parametrize(
    ("scene", "seed"),
    [
        pytest.param(scene, seed, id=why, marks=() if scene in QUICK else pytest.mark.extended)
        for scene, seed, why in CASES
    ],
)
def test_the_reference_is_right(scene: int, seed: int) -> None:
    assert verdict(find_pack(scene), seed)["right"]
