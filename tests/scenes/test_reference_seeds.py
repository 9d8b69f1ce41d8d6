"""Tests the reference agent at seeds at which an earlier version of it was wrong."""

import pytest

from scenes import find_pack
from tests.harness.fresh_seeds import verdict


@pytest.mark.parametrize(
    ("scene", "seed"),
    [
        pytest.param(26, 4176143356, id="the guard gripped a cart that coasted slower than planned"),
        pytest.param(
            28, 1831608469, id="a second cord was presumed where there is none, and the latch held the glider"
        ),
        pytest.param(33, 343401748, id="a reading that fell short made the push off the pad too strong"),
        pytest.param(44, 4003639905, id="the float gained speed on a long way, and sank into the trap"),
        pytest.param(48, 395233773, id="the fit ignored the ranges that the task states"),
        pytest.param(76, 2165984442, id="the second cart moved too slowly to tell the size of its resistance"),
        pytest.param(76, 3306113100, id="the second cart moved too slowly to tell the kind of its resistance"),
        # An episode of scene 81 takes 5 s of processor time.
        pytest.param(
            81,
            378326033,
            id="one side was presumed as stiff as the other, and the pawl caught the crate",
            marks=pytest.mark.extended,
        ),
        pytest.param(97, 4205994631, id="a force grew fivefold at once, and the line that swung was parted"),
        pytest.param(
            100, 3881588331, id="a yielding dashpot carried a knob into its latch", marks=pytest.mark.extended
        ),
        pytest.param(
            100,
            78930479,
            id="the forces hardly exceeded the one from which a dashpot yields",
            marks=pytest.mark.extended,
        ),
        pytest.param(105, 2036144970, id="a pan swung under a new ball, and its stiff thread broke"),
        pytest.param(
            107, 2161080772, id="the fit omitted the inertia of pan and load, at 74 N", marks=pytest.mark.extended
        ),
        pytest.param(
            107, 3766720252, id="the fit omitted the inertia of pan and load, at 125 N", marks=pytest.mark.extended
        ),
        pytest.param(201, 850610864, id="a puck on one side of the floor determined a long wave too weakly"),
        pytest.param(212, 1924654402, id="a wrong mass led the puck into the rim"),
        pytest.param(215, 3031066160, id="the fit of a wave ended in a local minimum"),
        pytest.param(215, 2000933834, id="a wrong mass led the puck on waves into the rim"),
        # An episode of scene 216 takes 5 to 10 s of processor time.
        pytest.param(
            216, 524623619, id="a wrong estimate of the motion led the puck into the rim", marks=pytest.mark.extended
        ),
        pytest.param(
            216,
            594015080,
            id="the puck was led too slowly to distinguish two structures",
            marks=pytest.mark.extended,
        ),
        # An episode of scene 219 takes 10 to 20 s of processor time.
        pytest.param(
            219, 166530120, id="a wrong mass sent the puck on a leash into the rim", marks=pytest.mark.extended
        ),
        pytest.param(
            219,
            364440126,
            id="the readings determined the force of a leash with a grip too weakly",
            marks=pytest.mark.extended,
        ),
        pytest.param(
            219,
            3552809915,
            id="the readings determined the force of another leash too weakly",
            marks=pytest.mark.extended,
        ),
    ],
)
def test_the_reference_is_right(scene: int, seed: int) -> None:
    assert verdict(find_pack(scene), seed)["right"]
