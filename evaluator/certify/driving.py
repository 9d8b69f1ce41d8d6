"""Runs a reference protocol on a session, without MCP; its interventions can be replaced."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from evaluator.answers.engine import is_intervention, run
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from scenes.protocol import ANSWER, Call, Protocol, Reading

MAX_ITERATIONS = 20


@dataclass(slots=True)
class Drive:
    """The calls of a protocol and its result."""

    calls: list[Call] = field(default_factory=list[Call])
    iterations: int = 0
    refusals: list[str] = field(default_factory=list[str])
    """What refused calls returned."""
    answer: object = None
    failure: str = ""
    """Why the protocol failed; empty if it answered."""


async def drive(session: Session, solve: Callable[[str], Protocol], replaced: Sequence[Call] = ()) -> Drive:
    """Run a protocol to its end in a session.

    Args:
        session: A new session.
        solve: The protocol.
        replaced: Calls that take the place of the first interventions, in order, where the tool is the same. The
            protocol continues with the real readings.
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
