"""The laboratory withstands random calls, and the fuzzer detects faults that the tests plant."""

import argparse
import contextlib
import json
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from physment_mcp.errors import NotPossible, Unstable
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from physment_mcp.tools import calls
from physment_mcp.tools.results import Torque
from scenes.protocol import Call
from tests.harness.fuzz.drawing import draw_call, schemas
from tests.harness.fuzz.episodes import Failure, Tally, play_scene, replayed
from tests.harness.fuzz.invariants import Problem
from tests.harness.fuzz.private import _spellings
from tests.harness.fuzz.run import main, parse_scenes, play_all

SCENES = (7, 20, 24, 25, 31, 41, 46, 60, 67, 72, 87, 91, 96, 104, 109, 111, 206)
"""Scenes of every kind whose steps are fast: hidden objects, withheld readings, laws, limits, creating, attaching."""
HIDING = 25
"""A scene with hidden objects and withheld masses."""
PLAIN = 20
"""A scene in which objects can be created, attached and deleted."""

FOUND = Path(__file__).parent / "found"
"""Failures that the fuzzer found, and that were fixed."""

Plant = Callable[[pytest.MonkeyPatch], None]
Run = Callable[[Session, Any], Any]


@pytest.mark.parametrize("count", [1500, pytest.param(5000, marks=pytest.mark.extended)])
def test_random_calls_break_nothing(count: int) -> None:
    tally = Tally()
    for _, played in play_all(SCENES, count, 20260101, jobs=1):
        tally.calls += played.calls
        tally.refused += played.refused
        tally.failures += played.failures
    assert [(failure.problem, list(failure.calls)) for failure in tally.failures] == []
    assert tally.calls.total() == count
    # Every tool succeeds at least once, because calls that are always refused test nothing.
    assert set(schemas()) <= set(tally.calls)
    assert [tool for tool in schemas() if tally.calls[tool] == tally.refused[tool]] == []
    assert 0.3 < tally.refused.total() / count < 0.7


@pytest.mark.parametrize("file", sorted(FOUND.glob("*.json")), ids=lambda file: file.stem)
def test_what_was_found_and_mended_fails_no_more(file: Path) -> None:
    assert replayed(Failure.read(file)) is None


def test_a_step_that_the_engine_gives_up_is_refused_as_often_as_it_is_asked_for() -> None:
    found = Failure.read(FOUND / "the-engine-gives-up.json")
    session = Session(load_scene(found.scene, found.seed))
    *building, last = found.calls
    for call in building:
        calls.call(session, call.tool, call.arguments)
    for _ in range(3):
        with pytest.raises(Unstable):
            calls.call(session, last.tool, last.arguments)
        # After the error, the engine must have released the memory of the failed step.
        assert session.world.save().data.pstack == 0


def test_the_same_seed_makes_the_same_calls() -> None:
    first, second, other = (play_scene(PLAIN, 100, seed) for seed in (1, 1, 2))
    assert first == second
    assert first != other


def runs_instead(tool: str, run: Run) -> Plant:
    """Replace the function of a tool by a faulty one, which the fuzzer must detect."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        patch.setitem(calls._BY_NAME, tool, replace(calls._BY_NAME[tool], run=run))

    return plant


def push_and_refuse(session: Session, args: Any) -> Any:
    session.world.push(session.find(args.object_id).body, force=np.ones(3))
    raise NotPossible("it is too late")


def push_and_read(session: Session, args: Any) -> Any:
    session.world.push(session.find(args.object_id).body, torque=np.ones(3))
    return told({"x": 1.0, "y": 1.0, "z": 1.0})(session, args)


def refuse(sentence: Callable[[Session], str]) -> Run:
    def run(session: Session, args: Any) -> Any:
        raise NotPossible(sentence(session))

    return run


def told(torque: Any) -> Run:
    def run(session: Session, args: Any) -> Any:
        session.find(args.object_id)
        return Torque.model_construct(sim_time=session.world.time, torque=torque)

    return run


def hidden_id(session: Session) -> str:
    return next((item.object_id for item in session.state.objects.values() if not item.known), "nothing")


def withheld_mass(session: Session) -> str:
    masses = [
        session.world.mass(item.body)
        for item in session.state.objects.values()
        if not session.may_read(item, "mass") and session.world.is_movable(item.body)
    ]
    return f"it weighs {masses[0]:.6g} kg"


def crash(session: Session, args: Any) -> Any:
    raise KeyError(args.object_id)


def step_and_set(session: Session, args: Any) -> Any:
    session.world.step(1)
    return told({"x": 0.0, "y": 0.0, "z": 0.0})(session, args)


def paint(session: Session, args: Any) -> Any:
    """Plant a fault in the spec from which later models are compiled; fingerprints of calls do not include the spec."""
    session.world._spec.geoms[0].rgba[0] = 0.123
    return told({"x": 0.0, "y": 0.0, "z": 0.0})(session, args)


def never_undone(patch: pytest.MonkeyPatch) -> None:
    """Make `attach_objects` join a pair before it checks the arguments, and disable roll-back."""

    def join_first(session: Session, args: Any) -> Any:
        first, second = session.find(args.object1_id), session.find(args.object2_id)
        session.join(first, second)
        return attach(session, args)

    attach = calls._BY_NAME["attach_objects"].run
    runs_instead("attach_objects", join_first)(patch)
    patch.setattr(Session, "all_or_nothing", lambda _: contextlib.nullcontext())


def everything_may_be_read(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "may_read", lambda *_: True)


def hidden_is_known(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "known", lambda self: list(self.state.objects.values()))


def never_over(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "check_open", lambda _: None)


def never_counted(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "count_call", lambda *_, **__: None)


FAULTS: dict[str, tuple[int, Plant, str]] = {
    "a refusal pushes": (PLAIN, runs_instead("get_torque", push_and_refuse), "a refusal changed something"),
    "a reading pushes": (PLAIN, runs_instead("get_torque", push_and_read), "a reading changed something"),
    "nothing is undone": (PLAIN, never_undone, "a refusal changed something"),
    "NaN": (PLAIN, runs_instead("get_torque", told({"x": float("nan"), "y": 0.0, "z": 0.0})), "not finite"),
    "a wrong form": (PLAIN, runs_instead("get_torque", told([1.0, 2.0, 3.0])), "schema"),
    "a crash": (PLAIN, runs_instead("get_torque", crash), "crash"),
    "time passes": (PLAIN, runs_instead("get_torque", step_and_set), "clock"),
    "the spec is painted": (PLAIN, runs_instead("get_torque", paint), "twin"),
    "a hidden id in a refusal": (HIDING, runs_instead("get_torque", refuse(hidden_id)), "leak"),
    "hidden ids are listed": (HIDING, hidden_is_known, "leak"),
    "a withheld mass": (HIDING, runs_instead("get_torque", refuse(withheld_mass)), "leak"),
    "a body's own name": (PLAIN, runs_instead("get_torque", refuse(lambda _: "created:ball1 is there")), "leak"),
    "withheld readings": (HIDING, everything_may_be_read, "permission"),
    "no end": (PLAIN, never_over, "end"),
    "no count": (PLAIN, never_counted, "count"),
    "a long refusal": (PLAIN, runs_instead("get_torque", refuse(lambda _: "no " * 500)), "long sentence"),
    "two lines": (PLAIN, runs_instead("get_torque", refuse(lambda _: "no\nand no")), "sentence"),
    "an internal": (PLAIN, runs_instead("get_torque", refuse(lambda session: f"{session.world} is full")), "internals"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_planted_fault_is_found_shrunk_and_replayed(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, plant, kind = FAULTS[fault]
    plant(monkeypatch)
    (failure,) = play_scene(scene, 3000, 1, most_failures=1).failures
    assert failure.problem.kind == kind
    assert len(failure.calls) <= 6
    read = Failure.read(failure.write(tmp_path))
    problem = replayed(read)
    assert problem is not None
    assert problem.kind == kind
    monkeypatch.undo()
    assert replayed(read) is None


def test_the_command_prints_its_seed_and_writes_what_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = [
        "--calls",
        "600",
        "--frames",
        "0",
        "--seed",
        "3",
        "--scenes",
        f"{PLAIN}",
        "--jobs",
        "1",
        "--out",
        str(tmp_path / "out"),
    ]
    assert main(arguments) == 0
    assert "--seed 3" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()
    runs_instead("get_torque", crash)(monkeypatch)
    assert main(arguments) == 1
    printed = capsys.readouterr().out
    file, *others = (tmp_path / "out").iterdir()
    assert all(str(path) in printed for path in (file, *others))
    assert main(["--replay", str(file)]) == 1
    assert "crash: KeyError" in capsys.readouterr().out
    monkeypatch.undo()
    assert main(["--replay", str(file)]) == 0


def test_a_failure_survives_its_file_with_every_kind_of_argument(tmp_path: Path) -> None:
    session, source = Session(load_scene(PLAIN)), random.Random(1)
    drawn = [draw_call(session, (), {}, source) for _ in range(3000)]
    failure = Failure(PLAIN, 1, None, Problem("crash", "\ud800"), drawn)
    # NaN differs from itself, so the texts are compared.
    assert repr(Failure.read(failure.write(tmp_path))) == repr(failure)
    assert json.loads(json.dumps({"x": float("nan")}))["x"] != 0


def test_scenes_are_named_by_numbers_and_ranges() -> None:
    assert parse_scenes("7,20-22,201") == [7, 20, 21, 22, 201]
    for wrong in ("x", "1-2", "", "7-x"):
        with pytest.raises(argparse.ArgumentTypeError):
            parse_scenes(wrong)
    assert Call("step") != Call("answer")


def test_numbers_are_searched_for_with_so_many_digits_that_a_clock_does_not_show_them_by_chance() -> None:
    assert _spellings([12.850003, -0.123456789, 1234567.0, 2.5]) == {
        "12.850003", "0.123456789", "0.123457", "1234567.0", "1.23457e+06",
    }  # fmt: skip
