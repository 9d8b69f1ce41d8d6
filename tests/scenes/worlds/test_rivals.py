"""Tests of the certificate "determined": a wrong structure can fit few readings, but not many."""

import random

import numpy as np
import pytest

from scenes.worlds.acceptance import Maker
from scenes.worlds.answering import answers
from scenes.worlds.drawing import draw_constants
from scenes.worlds.experiment import Situation, simulated
from scenes.worlds.levels import difficulty_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question
from scenes.worlds.refits import Refits
from scenes.worlds.rivals import rival_of
from scenes.worlds.terms import Structure, Term

STRUCTURE = Structure(Apparatus.WHEEL, (Term("friction"), Term("slope", ("fading",))))
CONSTANTS = draw_constants(STRUCTURE, random.Random(3))
ASKED = (
    Question("late", (0.5,), (4.0,), (0.0,), 40.0, 2.5, "dq"),
    Question("strong", (0.5,), (0.0,), (9.0,), 0.0, 2.0, "u"),
)


@pytest.mark.parametrize(("looks", "noise", "found"), [(12, 0.05, True), (60, 0.001, False)])
def test_few_readings_leave_a_rival_and_many_do_not(looks: int, noise: float, found: bool) -> None:
    told = Situation(Apparatus.WHEEL, 6.0, 5.0, looks, noise)
    key = answers(STRUCTURE, CONSTANTS, ASKED, 0.02)[:, 0]
    rival = rival_of(Refits(STRUCTURE, CONSTANTS, told, simulated(STRUCTURE, CONSTANTS, told, 1)), ASKED, key)
    assert (rival is not None) == found
    if rival is not None:
        assert rival.structure != STRUCTURE
        again = Refits(STRUCTURE, CONSTANTS, told, simulated(STRUCTURE, CONSTANTS, told, 1))
        fits = again.search.tried
        same = rival_of(again, ASKED, key, rival)
        assert same is not None
        assert same.structure == rival.structure
        assert again.search.tried == fits + 1  # the given rival is tried before all others


def test_an_accepted_world_has_no_rival_in_other_readings() -> None:
    world = Maker(difficulty_of(2), random.Random(5)).world()
    refits = Refits(
        world.structure, world.constants, world.told, simulated(world.structure, world.constants, world.told, 1)
    )
    assert rival_of(refits, world.questions, np.array(world.key)) is None
