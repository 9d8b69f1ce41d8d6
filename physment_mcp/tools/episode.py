"""Tools that advance the episode: let time pass, and answer."""

import time
from typing import Annotated

from pydantic import Field

from physment_mcp.errors import BeyondLimit
from physment_mcp.session import MAX_SIMULATED_S, Session
from physment_mcp.tools.base import Arguments, Pieces, Progress, Tool
from physment_mcp.tools.results import Answered, Stepped

_PIECE_S = 0.05
"""Usual wall time of one piece of `step` [s]: how often it reports progress and can be cancelled."""

Part = str | int | float


class StepArguments(Arguments):
    """Arguments of `step`."""

    duration: Annotated[
        float, Field(gt=0, le=60, description="How long to simulate [s]; rounded to whole time steps, at least one.")
    ]


class AnswerArguments(Arguments):
    """Arguments of `answer`."""

    answer: Annotated[
        Annotated[str, Field(max_length=10_000)] | int | float | Annotated[list[Part], Field(max_length=1000)],
        Field(description="Your final answer: a number, a text, or a list of them. It is taken down as it is."),
    ]
    steps: Annotated[
        Annotated[dict[str, Part], Field(max_length=100)] | None,
        Field(description="Quantities found on the way, by name, if the task names any. Taken down beside the answer."),
    ] = None


def _step(session: Session, args: StepArguments) -> Pieces:
    world = session.world
    steps = world.whole_steps(args.duration)
    length = steps * world.timestep
    left = session.lab_time_left
    if length > left + world.timestep / 2:
        raise BeyondLimit(f"step: {length:g} s is too long: {left:g} s of laboratory time are left in this episode")
    done, piece, step_s = 0, 64, 1e-6
    while done < steps:
        most_s = (yield Progress(done * world.timestep, length)) or _PIECE_S
        # Pieces grow until one takes about this long; their size does not change the physics.
        piece = min(steps - done, piece, max(1, int(most_s / step_s)))
        started = time.perf_counter()
        world.step(piece)
        done += piece
        step_s = max(time.perf_counter() - started, 1e-6) / piece
        piece *= 8
    yield Progress(length, length)
    session.pass_time(length)
    return Stepped(sim_time=world.time, steps=steps, lab_time_left=session.lab_time_left, calls_left=session.calls_left)


def _answer(session: Session, args: AnswerArguments) -> Answered:
    session.answer(args.answer, args.steps)
    return Answered(sim_time=session.world.time, acknowledged=True)


STEP = Tool(
    "step",
    "Step",
    "Let time pass in the laboratory. Nothing moves unless you call this. An episode has"
    f" {MAX_SIMULATED_S:g} s of laboratory time, unless the scene says less.",
    StepArguments,
    Stepped,
    _step,
)
ANSWER = Tool(
    "answer",
    "Answer",
    "Give your final answer and end the episode. You have one chance; nothing is said about whether it is right.",
    AnswerArguments,
    Answered,
    _answer,
    destructive=True,
)
