"""Tools that advance the episode: let time pass, and answer."""

from typing import Annotated, Any

from pydantic import Field, WithJsonSchema

from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.contract.stated_laws import SCHEMA, StatedLaw
from physment_mcp.errors import BadArgument, BeyondLimit
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


_LAW = (
    "The law that you believe, if you know one: the acceleration of each object in SI units, without any rim, wall or"
    " stop. It is graded apart and does not change whether your answer is right. `acceleration` gives, for each object"
    " and each of x, y, z (m/s²) and angle (rad/s²), an expression; what is left out is 0. Expressions contain numbers,"
    " pi, + - * / % ** and brackets, comparisons, `a if c else b`, and, or, not, the functions abs min max sqrt exp log"
    " sin cos tan asin acos atan atan2 tanh hypot sign floor, and the names t (s); for each object, such as object_1:"
    " object_1_x, _y, _z (m), _vx, _vy, _vz (m/s), _angle (rad), _spin (rad/s), the force that you apply to it,"
    " object_1_push_x, _push_y, _push_z (N), and the torque, object_1_turn_x, _turn_y, _turn_z (N·m); the names that"
    " `let` defines, in order; and those of `state`, quantities that remember the past: `start` is the value at the"
    " start of the episode,"
    ' `rate` its time derivative. Example: {"acceleration": {"object_1": {"x": "object_1_push_x/m -'
    ' fresh*object_1_vx"}}, "let": {"m": 1.2, "fresh": "exp(-way/3)"}, "state": {"way": {"start": 0, "rate":'
    ' "abs(object_1_vx)"}}}. A law that cannot be read is refused, and the answer is not given.'
)


class LawAnswerArguments(AnswerArguments):
    """Arguments of `answer` in scenes that ask for a law."""

    law: Annotated[
        dict[str, Any] | None,
        Field(description=_LAW),
        WithJsonSchema({"anyOf": [SCHEMA, {"type": "null"}], "default": None, "description": _LAW}),
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


def _answer_with_law(session: Session, args: LawAnswerArguments) -> Answered:
    if args.law is not None:
        # Only the text and the ids of known objects decide, so a refusal does not depend on the law of the scene.
        listed = {one.object_id for one in session.scene.public.objects}
        try:
            StatedLaw(args.law, [item.object_id for item in session.known() if item.object_id in listed])
        except ExpressionError as error:
            raise BadArgument(f"answer: law: {error}; the answer is not given") from None
    session.answer(args.answer, args.steps, args.law)
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
ANSWER_WITH_LAW = Tool(
    ANSWER.name, ANSWER.title, ANSWER.description, LawAnswerArguments, Answered, _answer_with_law, destructive=True
)
"""`answer` in scenes that ask for a law too."""
