"""Tests that worlds of a level take the same time per step, and that padding has no effect on motion."""

import json
import random
from typing import Any

import mujoco
import numpy as np
import pytest

from physment_mcp.world import World
from scenes.worlds.drawing import draw_constants, draw_structure
from scenes.worlds.levels import GRAMMAR, LEVELS, difficulty_of
from scenes.worlds.packs import mjcf_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.records import WorldRecord

EACH = [(level, apparatus) for level in LEVELS for apparatus in difficulty_of(level).apparatuses]


def drawn_record(level: int, apparatus: Apparatus, rng: random.Random) -> WorldRecord:
    """Return a record of a random world, to which no acceptance test was applied."""
    structure = draw_structure(difficulty_of(level).changed(apparatuses=(apparatus,)), rng)
    return WorldRecord(
        grammar=GRAMMAR, level=level, index=0, split="train", salt="s", apparatus=apparatus,
        terms=tuple((term.form, term.modulations) for term in structure.terms),
        constants=draw_constants(structure, rng), radius=6.0, force=5.0, looks=12, noise=0.002, questions=(),
    )  # fmt: skip


def counts(mjcf: str) -> tuple[int, ...]:
    """Count laws, bodies, joints, function calls, operations, and readings of bodies."""
    spec = mujoco.MjSpec.from_string(mjcf)
    laws: list[dict[str, Any]] = json.loads(next(text.data for text in spec.texts if text.name == "laws"))
    texts = [text for law in laws for name in ("force", "torque") for text in law.get(name, ())]
    texts += [text for law in laws for text in law.get("let", {}).values()]
    whole = " ".join(texts)
    powers = whole.count("**")
    operations = sum(whole.count(sign) for sign in "+-*/") - 2 * powers
    calls = sum(whole.count(f"{name}(") for name in ("sqrt", "sin", "cos", "tanh", "exp", "max", "min"))
    return len(laws), len(spec.bodies), len(spec.joints), calls + powers, operations


@pytest.mark.parametrize(("level", "apparatus"), EACH)
def test_all_worlds_of_a_level_take_the_same_work(level: int, apparatus: Apparatus) -> None:
    rng = random.Random(level)
    assert len({counts(mjcf_of(drawn_record(level, apparatus, rng))) for _ in range(20)}) == 1


@pytest.mark.parametrize("apparatus", difficulty_of(5).apparatuses)
def test_padding_changes_no_bit_of_the_motion(apparatus: Apparatus) -> None:
    record = drawn_record(5, apparatus, random.Random(3))

    def motion(*, padded: bool) -> list[bytes]:
        world, seen = World(mjcf_of(record, padded=padded)), list[bytes]()
        wheel = apparatus is Apparatus.WHEEL
        world.push("object_1", **{"torque" if wheel else "force": np.array([0, 0, 2.0] if wheel else [2.0, 0, 0])})
        for _ in range(5):
            world.step(50)
            parts = (world.pose("object_1").position, *world.twist("object_1"))
            seen.append(b"".join(part.tobytes() for part in parts))
        return seen

    padded = motion(padded=True)
    assert motion(padded=False) == padded
    assert len(set(padded)) == 5
