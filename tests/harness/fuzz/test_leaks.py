"""The search for leaks finds planted formulas and a planted initial difference."""

import random

import anyio
import numpy as np
import pytest

from evaluator.certify.subject import Subject
from physment_mcp.scene import load_scene
from physment_mcp.serving import resources
from physment_mcp.session import Session
from scenes import find_pack
from tests.builders.bench import fingerprint
from tests.harness.fuzz.batches import MOST_CALLS, draw_batch, play_batch
from tests.harness.fuzz.formulas import Array, Tolerance, best_formula
from tests.harness.fuzz.leaks import main, revealing

CLOSE = Tolerance(0, 1e-6)
SOURCE = np.random.default_rng(1)
X, Y, NOISE = (SOURCE.uniform(1, 5, 36) for _ in range(3))


@pytest.mark.parametrize(
    ("keys", "formula"),
    [
        (2 - 3 * X, "a + b·x"),
        (7 * X**2.5, "c·(x)^p"),
        (-np.sqrt(X * Y), "c·(x · y)^p"),
        (4 * Y / X, "c·(x / y)^p"),
        (np.full(36, 3.0), "constant"),
    ],
)
def test_a_planted_formula_is_found_and_holds_on_other_seeds(keys: Array, formula: str) -> None:
    found = best_formula(np.column_stack([X, Y, NOISE]), ["x", "y", "noise"], keys, 24, CLOSE)
    assert (found.formula, found.fitted, found.held_out) == (formula, 1, 1)


def test_a_key_that_follows_from_nothing_is_not_found() -> None:
    features = np.column_stack([X, Y, np.where(X > 3, np.nan, X)])
    found = best_formula(features, ["x", "y", "gap"], NOISE + X * Y**2, 24, CLOSE)
    assert found.held_out == 0


def test_a_batch_is_accepted_short_and_leaves_no_trace() -> None:
    session, source = Session(load_scene(60)), random.Random(1)
    before, counted = fingerprint(session), session.calls
    for _ in range(20):
        batch = draw_batch(session, source)
        features, names = play_batch([session, session], batch)
        assert len(batch) <= MOST_CALLS
        assert features.shape == (2, len(names))
        assert np.array_equal(features[0], features[1])
    assert (fingerprint(session), session.calls) == (before, counted)


def test_a_scene_of_one_measurement_is_answered_by_a_batch(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--scenes", "7", "--minutes", "0", "--batches", "8"]) == 0
    printed = capsys.readouterr().out
    assert "100%" in printed
    assert "twins differ in 0 of 1 scenes" in printed


def test_a_resource_that_depends_on_the_seed_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    subject = Subject.open(find_pack(7, None))
    assert anyio.run(revealing, subject, 1) == ""
    view = resources._scene_view
    monkeypatch.setattr(
        resources, "_scene_view", lambda session: view(session) | {"g": session.world._model.opt.gravity[2]}
    )
    assert anyio.run(revealing, subject, 1).startswith("scene ")
