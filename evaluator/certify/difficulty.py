"""Certificate 5: the difficulty of a scene matches its category. Runs reference protocols on a session, without MCP."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import anyio

from evaluator.answers.engine import is_intervention, run
from evaluator.certify.records import Check, check
from evaluator.certify.subject import Subject
from evaluator.records.episode import Episode
from physment_mcp.errors import SceneError
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from scenes import Category, Pack, PackError, PackFiles
from scenes.protocol import ANSWER, Call, Protocol, Reading

MAX_ITERATIONS = 20


@dataclass(slots=True)
class Drive:
    """The calls that a protocol made in a session, and the answer of the protocol."""

    calls: list[Call] = field(default_factory=list[Call])
    iterations: int = 0
    refusals: list[str] = field(default_factory=list[str])
    """Messages of refused calls."""
    answer: object = None
    failure: str = ""
    """Why the protocol failed; empty if it answered."""


async def drive(session: Session, solve: Callable[[str], Protocol], replaced: Sequence[Call] = ()) -> Drive:
    """Run a protocol to its end in a session.

    Args:
        session: A new session.
        solve: The protocol.
        replaced: Calls that replace the first interventions, in order, where the tool is the same. The protocol
            continues with the real readings.
    """
    driven, spare = Drive(), list(replaced)
    protocol = solve(opening_prompt(session))
    try:
        batch = next(protocol)
        for _ in range(MAX_ITERATIONS):
            readings: list[Reading] = []
            driven.iterations += 1
            for asked in batch:
                done = asked
                if is_intervention(asked.tool, asked.arguments) and spare:
                    instead = spare.pop(0)
                    done = instead if instead.tool == asked.tool else asked
                driven.calls.append(done)
                readings.append(await run(session, done))
                driven.refusals += [str(readings[-1]["error"])] if "error" in readings[-1] else []
                if asked.tool == ANSWER:
                    driven.answer = session.state.answer
                    return driven
            batch = protocol.send(readings)
    except StopIteration:
        driven.failure = "the protocol ended without an answer"
    except Exception as error:  # noqa: BLE001 - a protocol may raise anything if its readings are unexpected
        driven.failure = repr(error)
    return driven


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
    """Wrap a protocol so that it also appends its turns to a list."""

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


EASY_INTERVENTIONS, EASY_ITERATIONS, ITERATIONS = 3, 5, 20
"""Largest numbers of interventions and of iterations in an Easy scene, and of iterations in any scene."""


async def check_difficulty(subject: Subject, episodes: Sequence[Episode]) -> Check:
    """Check the length of the reference protocol and the number of concepts.

    A Hard scene whose pack sets no limits must also require adaptive experiments (see `_wrong_by_rote`). For scenes
    with limits, certificates 7 to 9 check this instead.
    """
    category = subject.pack.category
    assert category is not None
    interventions = [_interventions(episode) for episode in episodes]
    iterations = [len(episode.turns) for episode in episodes]
    reasons: list[str] = []
    if category.value.startswith("easy"):
        if max(interventions) > EASY_INTERVENTIONS:
            reasons.append(
                f"the reference intervenes {max(interventions)} times; in an Easy scene at most {EASY_INTERVENTIONS}"
            )
        if max(iterations) > EASY_ITERATIONS:
            reasons.append(
                f"the reference takes {max(iterations)} iterations; in an Easy scene at most {EASY_ITERATIONS}"
            )
    adapts = category.value.startswith("hard") and not subject.pack.predicts
    if adapts and min(interventions) <= EASY_INTERVENTIONS:
        reasons.append(
            f"the reference needs only {min(interventions)} interventions; a Hard scene needs more than"
            f" {EASY_INTERVENTIONS}"
        )
    if max(iterations) > ITERATIONS:
        reasons.append(f"the reference takes {max(iterations)} iterations; the largest budget is {ITERATIONS}")
    reasons += concept_faults(subject.pack)
    called = {exchange.call.tool for episode in episodes for turn in episode.turns for exchange in turn.exchanges}
    reasons += [
        f"requires names {tool}, but the reference never calls it"
        for tool in subject.pack.requires
        if tool not in called
    ]
    figures: dict[str, float | list[str]] = {
        "interventions": max(interventions),
        "iterations": max(iterations),
        "tools": sorted(called - {"answer"}),
    }
    if adapts:
        tried = len(episodes) - 1
        wrong = await _wrong_by_rote(subject, tried)
        figures |= {"wrong_by_rote": wrong, "tried_by_rote": tried}
        if wrong * 2 <= tried:
            reasons.append(
                f"the interventions of seed 0, with the right readings, are wrong on only {wrong} of {tried} other"
                " seeds: a Hard scene must force to adapt"
            )
    return check("difficulty", reasons, **figures)


def concept_faults(pack: Pack) -> Iterator[str]:
    """Yield a sentence if a pack lists too many or too few concepts; open worlds may have any number."""
    if pack.category is None or pack.category is Category.OPEN:
        return
    several = "multi" in pack.category.value or pack.category is Category.CREATE_DELETE_ATTACH
    if (len(pack.concepts) >= 2) != several:
        yield (
            f"{pack.category.value} scenes have {'two or more concepts' if several else 'one concept'};"
            f" this one lists {len(pack.concepts)}"
        )


def _interventions(episode: Episode) -> int:
    calls = (exchange.call for turn in episode.turns for exchange in turn.exchanges)
    return sum(is_intervention(call.tool, call.arguments) for call in calls)


async def _wrong_by_rote(subject: Subject, seeds: int) -> int:
    """Count the seeds at which repeating the interventions of seed 0 leads to a wrong answer."""
    solve = subject.solution.solve
    assert solve is not None
    first = await drive(subject.session(subject.draw(0)), solve)
    rote = [call for call in first.calls if is_intervention(call.tool, call.arguments)]
    wrong = 0
    for seed in range(1, seeds + 1):
        draw = subject.draw(seed)
        driven = await drive(subject.session(draw), solve, rote)
        wrong += bool(driven.failure) or not subject.agrees(driven.answer, subject.truth(draw))
    return wrong
