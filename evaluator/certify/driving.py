"""Driving a reference protocol at the laboratory's own door, with its interventions replaced if wanted."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from evaluator.answers.engine import is_intervention, run
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from scenes.protocol import ANSWER, Call, Protocol, Reading

MAX_ITERATIONS = 20


@dataclass(slots=True)
class Drive:
    """What was called, and what came of it."""

    calls: list[Call] = field(default_factory=list[Call])
    answer: object = None
    failure: str = ""
    """What the protocol raised, if it did."""


async def drive(session: Session, solve: Callable[[str], Protocol], replaced: Sequence[Call] = ()) -> Drive:
    """Let a protocol run its course in a session.

    Args:
        session: A fresh session.
        solve: The protocol.
        replaced: The first interventions get the arguments of these, one for one where the tool is the same; the
            protocol goes on with what is really read.
    """
    driven, spare = Drive(), list(replaced)
    protocol = solve(opening_prompt(session))
    try:
        batch = next(protocol)
        for _ in range(MAX_ITERATIONS):
            readings: list[Reading] = []
            for asked in batch:
                done = asked
                if is_intervention(asked.tool, asked.arguments) and spare:
                    instead = spare.pop(0)
                    done = instead if instead.tool == asked.tool else asked
                driven.calls.append(done)
                readings.append(await run(session, done))
                if asked.tool == ANSWER:
                    driven.answer = session.state.answer
                    return driven
            batch = protocol.send(readings)
    except StopIteration:
        driven.failure = "the protocol ended without an answer"
    except Exception as error:  # noqa: BLE001 - a protocol fed with strange readings may raise anything
        driven.failure = repr(error)
    return driven
