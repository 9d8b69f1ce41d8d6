"""What a reference protocol does in a scene at a seed, turn by turn, at the laboratory's own door."""

from collections.abc import Callable
from dataclasses import dataclass

import anyio

from evaluator.answers.engine import is_intervention
from evaluator.certify.driving import drive
from evaluator.certify.subject import Subject
from physment_mcp.errors import SceneError
from scenes import PackError, PackFiles
from scenes.protocol import Call, Protocol, Reading


@dataclass(frozen=True, slots=True)
class Turn:
    """One iteration: calls, and what came of each. The last turn, which answers, has no readings."""

    calls: tuple[Call, ...]
    readings: tuple[Reading, ...] = ()


@dataclass(frozen=True, slots=True)
class Transcript:
    """A whole run."""

    turns: tuple[Turn, ...]
    method: str
    """The docstring of the protocol."""

    @property
    def interventions(self) -> int:
        """How many calls changed the world."""
        return sum(is_intervention(call.tool, call.arguments) for turn in self.turns for call in turn.calls)


def play(files: PackFiles, seed: int) -> Transcript:
    """Let the reference protocol of a pack run its course. This executes the pack's `solution.py`.

    Raises:
        PackError: The pack is malformed, or its protocol failed.
    """
    subject = Subject.open(files)
    solve = subject.solution.solve
    assert solve is not None
    turns: list[Turn] = []
    try:
        session = subject.session(subject.draw(seed))
    except SceneError as error:
        raise PackError(files.mjcf, str(error)) from error
    driven = anyio.run(drive, session, _overheard(solve, turns))
    if driven.failure:
        raise PackError(files.solution, f"the reference protocol failed at seed {seed}: {driven.failure}")
    return Transcript(tuple(turns), (solve.__doc__ or "").strip())


def _overheard(solve: Callable[[str], Protocol], turns: list[Turn]) -> Callable[[str], Protocol]:
    """The same protocol, with its turns noted down."""

    def overheard(task: str) -> Protocol:
        protocol = solve(task)
        batch = next(protocol)
        while True:
            turns.append(Turn(tuple(batch)))
            readings = yield batch
            turns[-1] = Turn(tuple(batch), tuple(readings))
            try:
                batch = protocol.send(readings)
            except StopIteration:
                return

    return overheard
