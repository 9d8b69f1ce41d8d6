"""Tests that protocols written from the opening prompt alone find the same answers as the reference protocols."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from evaluator.answers.grading import grade
from evaluator.answers.keys import KeyRing
from evaluator.certify.difficulty import drive
from evaluator.certify.subject import Subject
from evaluator.records.episode import Verdict
from scenes import Category, find_pack, read_pack
from scenes.pack import Rung

FOLDER = Path(__file__).parent / "second_solvers"
SOLVERS = {int(file.stem.removeprefix("scene")): file for file in sorted(FOLDER.glob("scene*.py"))}
KEYS = KeyRing()


def second_solver(scene: int) -> ModuleType:
    """Load the module of a second protocol; it defines `solve(task)`, as a pack's `solution.py` does."""
    spec = spec_from_file_location(f"second_solver_{scene}", SOLVERS[scene])
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("seed", [0, 1, 2])
@pytest.mark.parametrize("scene", SOLVERS)
async def test_a_second_solver_finds_the_same_key(scene: int, seed: int) -> None:
    subject = Subject.open(find_pack(scene))
    driven = await drive(subject.session(subject.draw(seed)), second_solver(scene).solve)
    assert not driven.failure
    verdict = grade(driven.answer, KEYS.key(scene, seed))  # pyright: ignore[reportArgumentType] - a solver may submit any object
    assert verdict.strict is Verdict.CORRECT, verdict.reason


def test_second_solvers_cover_all_easy_categories() -> None:
    covered = {read_pack(find_pack(scene)).category for scene in SOLVERS}
    assert covered >= {category for category in Category if category.rung is Rung.EASY}
