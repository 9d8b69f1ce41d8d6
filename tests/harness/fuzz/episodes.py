"""Plays episodes of random calls, and replays them: all calls to reproduce a failure, or only the changing ones.

An episode is determined by its scene and its seeds.
"""

import json
import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Self

from physment_mcp.errors import SceneError
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from scenes.protocol import Call
from tests.builders.kept import forget_scenes
from tests.harness.fuzz.drawing import MOODS, draw_call
from tests.harness.fuzz.invariants import Problem, changes_nothing, fingerprint, model_bytes, play_call
from tests.harness.fuzz.private import Private, private_of

LENGTHS = (10, 60, 150, 400)
"""Numbers of calls of an episode; one is drawn."""
_AFTER_THE_END = 3
"""Calls that are still made when an episode has ended."""
_PLAYED_TWICE = 0.25
"""Share of episodes whose state-changing calls are played again in a new session."""
_ATTEMPTS = 300
"""Largest number of replays while a failure is shortened."""


@dataclass(frozen=True, slots=True)
class Failure:
    """Calls that break an invariant."""

    scene: int
    seed: int
    """Seed of the scene's hidden values."""
    max_calls: int | None
    problem: Problem
    calls: Sequence[Call]

    def write(self, folder: Path) -> Path:
        """Write the failure into a folder; returns the file."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"scene{self.scene}-seed{self.seed}-{self.problem.kind.replace(' ', '-')}.json"
        path.write_text(json.dumps(asdict(self), indent=1) + "\n", encoding="utf-8")
        return path

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read one back."""
        said = json.loads(path.read_text(encoding="utf-8"))
        said["problem"], said["calls"] = Problem(**said["problem"]), [Call(**call) for call in said["calls"]]
        return cls(**said)


@dataclass(slots=True)
class Tally:
    """Counts of episodes and calls so far, and the failures."""

    calls: Counter[str] = field(default_factory=Counter[str])
    refused: Counter[str] = field(default_factory=Counter[str])
    episodes: int = 0
    failures: list[Failure] = field(default_factory=list[Failure])


def play_scene(scene: int, count: int, seed: int, *, most_failures: int = 3) -> Tally:
    """Play episodes of a scene until a number of calls are made.

    Args:
        scene: Id of the scene.
        count: Number of calls.
        seed: Seed of the random generator.
        most_failures: Number of failures after which to stop.
    """
    tally = Tally()
    while (left := count - tally.calls.total()) > 0 and len(tally.failures) < most_failures:
        source = random.Random(f"{seed}:{scene}:{tally.episodes}")
        failure = _play_episode(scene, min(left, source.choice(LENGTHS)), source, tally)
        tally.episodes += 1
        if failure is not None:
            tally.failures.append(shrunk(failure))
    return tally


def _play_episode(scene: int, length: int, source: random.Random, tally: Tally) -> Failure | None:
    """Play one episode of random calls; returns the first failure."""
    seed, max_calls = source.randrange(1000), source.choice((None, None, None, length // 2 + 1))
    mood = source.choice(MOODS)
    try:
        session, private = _opened(scene, seed, max_calls)
    except SceneError as error:
        return Failure(scene, seed, max_calls, Problem("scene", str(error)), [])
    made: list[Call] = []
    changed: list[Call] = []
    deleted: set[str] = set()
    over = 0
    while len(made) < length and over < _AFTER_THE_END:
        known = set(session.state.objects)
        call = draw_call(session, sorted(deleted), mood, source)
        made.append(call)
        tally.calls[call.tool] += 1
        over += session.ended
        played = play_call(session, private, call)
        deleted |= known - set(session.state.objects)
        if played.problem is not None:
            return Failure(scene, seed, max_calls, played.problem, made)
        if played.refused:
            tally.refused[call.tool] += 1
        elif not changes_nothing(call):
            changed.append(call)
    if source.random() < _PLAYED_TWICE and (problem := _differs(session, seed, changed)):
        return Failure(scene, seed, max_calls, problem, made)
    return None


def _opened(scene: int, seed: int, max_calls: int | None) -> tuple[Session, Private]:
    session = Session(load_scene(scene, seed), max_calls=max_calls)
    return session, private_of(session, seed)


def _differs(session: Session, seed: int, changed: Sequence[Call]) -> Problem | None:
    """Replay only the state-changing calls of an episode, and return a problem if the final state differs."""
    # The twin compiles its scene anew, because both sessions would see a change to a shared model.
    forget_scenes()
    twin, private = _opened(session.scene.public.scene_id, seed, None)
    for call in changed:
        if play_call(twin, private, call).refused:
            return Problem("twin", f"{call.tool} is refused if no readings and refusals come before it")
    ours, theirs = session.world.save(), twin.world.save()
    if (ours.disturbed, ours.revealed) != (theirs.disturbed, theirs.revealed):
        return Problem("twin", "without readings and refusals other bodies count as disturbed or revealed")
    if ours.state.tobytes() != theirs.state.tobytes():
        return Problem("twin", "without readings and refusals the state is another")
    if model_bytes(ours.model) != model_bytes(theirs.model) or ours.spec.to_xml() != theirs.spec.to_xml():
        return Problem("twin", "without readings and refusals the model is another")
    # The first six fields are those of the session; later ones contain addresses, which always differ.
    if fingerprint(session)[:6] != fingerprint(twin)[:6]:
        return Problem("twin", "without readings and refusals the session is another")
    return None


def replayed(failure: Failure) -> Problem | None:
    """Repeat the calls of a failure; returns the first problem."""
    try:
        session, private = _opened(failure.scene, failure.seed, failure.max_calls)
    except SceneError as error:
        return Problem("scene", str(error))
    changed: list[Call] = []
    for call in failure.calls:
        played = play_call(session, private, call)
        if played.problem is not None:
            return played.problem
        if not (played.refused or changes_nothing(call)):
            changed.append(call)
    return _differs(session, failure.seed, changed) if failure.problem.kind == "twin" else None


def shrunk(failure: Failure) -> Failure:
    """Shorten a failure by dropping calls, larger parts first, while it still fails."""
    for max_calls in (None, 1):
        problem = replayed(shorter := replace(failure, max_calls=max_calls))
        if problem is not None and problem.kind == failure.problem.kind:
            failure = replace(shorter, problem=problem)
            break
    calls, attempts = list(failure.calls), 0
    size = max(1, len(calls) // 2)
    while size and attempts < _ATTEMPTS:
        place = 0
        while place < len(calls) and attempts < _ATTEMPTS:
            fewer = calls[:place] + calls[place + size :]
            attempts += 1
            problem = replayed(replace(failure, calls=fewer))
            if problem is not None and problem.kind == failure.problem.kind:
                calls, failure = fewer, replace(failure, calls=fewer, problem=problem)
            else:
                place += size
        size //= 2
    return failure
