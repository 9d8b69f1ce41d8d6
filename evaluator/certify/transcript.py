"""The transcript of a reference protocol in a scene at a seed, played on a session in this process."""

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
class ReferenceTurn:
    """One iteration of a reference protocol: its calls and their results. The answering turn has no results."""

    calls: tuple[Call, ...]
    readings: tuple[Reading, ...] = ()


@dataclass(frozen=True, slots=True)
class Transcript:
    """All turns of a reference protocol."""

    turns: tuple[ReferenceTurn, ...]
    method: str
    """The docstring of the protocol's `solve`."""

    @property
    def interventions(self) -> int:
        """Number of calls that changed the world."""
        return sum(is_intervention(call.tool, call.arguments) for turn in self.turns for call in turn.calls)


def play(files: PackFiles, seed: int) -> Transcript:
    """Run the reference protocol of a pack to its end. This executes the pack's `solution.py`.

    Raises:
        PackError: The pack is malformed, or its protocol failed.
    """
    subject = Subject.open(files)
    solve = subject.solution.solve
    assert solve is not None
    turns: list[ReferenceTurn] = []
    try:
        session = subject.session(subject.draw(seed))
    except SceneError as error:
        raise PackError(files.mjcf, str(error)) from error
    driven = anyio.run(drive, session, _recorded(solve, turns))
    if driven.failure:
        raise PackError(files.solution, f"the reference protocol failed at seed {seed}: {driven.failure}")
    return Transcript(tuple(turns), (solve.__doc__ or "").strip())


def _recorded(solve: Callable[[str], Protocol], turns: list[ReferenceTurn]) -> Callable[[str], Protocol]:
    """The same protocol, which also appends its turns to a list."""

    def recorded(task: str) -> Protocol:
        protocol = solve(task)
        batch = next(protocol)
        while True:
            turns.append(ReferenceTurn(tuple(batch)))
            readings = yield batch
            turns[-1] = ReferenceTurn(tuple(batch), tuple(readings))
            try:
                batch = protocol.send(readings)
            except StopIteration:
                return

    return recorded
