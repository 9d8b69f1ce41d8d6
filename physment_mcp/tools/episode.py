"""Tools that advance the episode: let time pass, and answer."""

from typing import Annotated

from pydantic import Field

from physment_mcp.errors import BeyondLimit
from physment_mcp.session import MAX_SIMULATED_S, Session
from physment_mcp.tools.base import Arguments, Pieces, Progress, Tool
from physment_mcp.tools.results import Answered, Stepped

_PIECE_S = 0.05
"""Usual wall time of one piece of `step` [s]: how often it reports progress and can be cancelled."""
_TRIED = 8
"""Number of time steps in the first piece, which measures how long a time step takes."""

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
    done = 0
    while done < steps:
        # The size of the pieces does not change the physics.
        pace_s = world.pace_s or 0.0
        piece = min(steps - done, max(1, int(_PIECE_S / pace_s)) if done and pace_s else _TRIED)
        most_s = yield Progress(done * world.timestep, length, piece * pace_s)
        if most_s is not None and pace_s:
            piece = min(steps - done, max(1, int(most_s / pace_s)))
        world.step(piece)
        done += piece
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
