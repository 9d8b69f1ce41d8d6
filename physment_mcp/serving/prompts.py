"""The opening prompt: the information that every agent gets before its first call, with any client.

It contains only information that is public at the start of the episode, so it never depends on hidden values.
"""

from dataclasses import dataclass
from enum import StrEnum

from physment_mcp.serving.examples import EXAMPLES, shown
from physment_mcp.serving.prompt_blocks import LAW_BLOCK, answer_block, laboratory_blocks, steps_block, tool_listing
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.calls import tools_of


class Prompting(StrEnum):
    """The number of worked examples in the prompt."""

    ZERO_SHOT = "zero-shot"
    ONE_SHOT = "one-shot-cot"
    FEW_SHOT = "few-shot-cot"


class CallProtocol(StrEnum):
    """The format in which the agent writes its calls."""

    NATIVE = "native"
    TEXT = "text"


@dataclass(frozen=True, slots=True)
class PromptOptions:
    """The client's options for the opening prompt."""

    prompting: Prompting = Prompting.ZERO_SHOT
    protocol: CallProtocol = CallProtocol.NATIVE
    budget: int | None = None


IDLE_INSTRUCTIONS = (
    "PhysMent is a physics laboratory. No scene is open yet: ask the user to choose the prompt `scene` with a"
    " scene_id, which opens one and tells you its task. Then experiment with the tools and give one final answer."
)

_COLUMNS = (
    ("type", "type"),
    ("density", "density kg/m³"),
    ("mass", "mass kg"),
    ("size", "size m"),
    ("radius", "radius m"),
    ("position", "position m"),
    ("orientation", "orientation"),
)


def opening_prompt(session: Session, options: PromptOptions = PromptOptions()) -> str:
    """Return the complete opening prompt of an episode.

    Args:
        session: The episode. Only information that is public at its start is used.
        options: Prompting, call protocol and iteration budget.
    """
    text = options.protocol is CallProtocol.TEXT
    scene = session.scene.public
    blocks = [
        "You are an experimental physicist in a simulated laboratory. Nothing is known but what you are told here and"
        " what you measure.",
        f"# Scene: {scene.name}\n\n{scene.task}",
        _objects(session),
        "# Conventions\n\nSI units. World frame, z up. Vectors are [x, y, z], quaternions [w, x, y, z]. The time step"
        f" is {session.world.timestep:g} s. Sizes are full edge lengths along the object's own axes.",
        *laboratory_blocks(scene),
        _tools(session, listing=text),
        _returns(text=text),
        *_examples(options.prompting, text=text),
        answer_block(scene.answer_form, scene.problem_type),
        *steps_block(scene.steps),
        *([LAW_BLOCK] if scene.law_answer else []),
        "# Guidelines\n\nTime stands still until you call `step`. Forces and torques keep acting until you set them"
        " again. Assume nothing that you can measure. You can answer once; the answer ends the episode."
        + ("" if text else " Before each set of calls, say in a sentence or two why you make them."),
    ]
    if text:
        blocks.append(
            "# Format\n\nWrite your reasoning as prose, then exactly one JSON list of calls in a ```json block:\n\n"
            '```json\n[{"tool": "step", "parameters": {"duration": 0.1}}]\n```\n\n'
            f"{_BATCH} A reply without a list that can be read, or with more than one list, runs nothing and still"
            " counts as an iteration."
        )
    if options.budget is not None:
        blocks.append(
            f"# Budget\n\nYou have {options.budget} iterations. An iteration is one reply of yours, with as many tool"
            " calls as you like. If you have not answered when they are used up, the task counts as failed."
            # A client that names no budget, such as a desktop application, runs calls in its own way.
            + ("" if text else f" {_BATCH}")
        )
    return "\n\n".join(blocks)


_BATCH = (
    "The calls of a reply run in order. A call that fits no tool ends them: the calls before it stand, the call and"
    " those after it are not run. A call that the laboratory refuses does not end them."
)
"""The rule by which the evaluator runs the calls of an iteration, in both protocols."""


def _objects(session: Session) -> str:
    if not session.opening:
        return "# Objects\n\nYou see no object that you could name."
    columns = [(key, title) for key, title in _COLUMNS if any(look[key] is not None for _, look in session.opening)]
    lines = [
        "| id | name | " + " | ".join(title for _, title in columns) + " |",
        "|---" * (2 + len(columns)) + "|",
    ]
    for item, look in session.opening:
        cells = [_cell(look[key]) for key, _ in columns]
        lines.append("| " + " | ".join([item.object_id, item.name, *cells]) + " |")
    sealed = [item.object_id for item, _ in session.opening if not item.permissions.actuate]
    unread = [item.object_id for item, _ in session.opening if not item.permissions.velocity]
    notes = ["n/a: not shown in this scene." if any("n/a" in line for line in lines) else ""]
    notes.append(f"Sealed, to be observed but not acted on: {', '.join(sealed)}." if sealed else "")
    notes.append(f"Velocity and what follows from it withheld: {', '.join(unread)}." if unread else "")
    return "# Objects\n\n" + "\n".join(lines) + "".join(f"\n\n{note}" for note in notes if note)


def _cell(value: object) -> str:
    if value is None:
        return "n/a"
    if isinstance(value, list):
        return "[" + ", ".join(f"{part:.6g}" for part in value) + "]"  # pyright: ignore[reportUnknownVariableType] - numbers
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _tools(session: Session, *, listing: bool) -> str:
    disabled = [tool.name for tool in TOOLS if tool.name in session.scene.public.disabled_tools]
    parts = ["# Tools"]
    if listing:
        parts += [tool_listing(tools_of(session)), _ID_AND_CLOCK]
    else:
        parts.append(f"You have {len(TOOLS)} tools; each says what it does, in which units.")
    if disabled:
        parts.append(f"Not available in this scene: {', '.join(disabled)}.")
    return "\n\n".join(parts)


_ID_AND_CLOCK = (
    "An `object_id` is an id such as object_1; 1 means object_1. Every result also has `sim_time`, the simulation clock"
    " after the call [s]."
)


def _returns(*, text: bool) -> str:
    shown = '{"sim_time":0.25,"velocity":[0.0,0.0,-2.4525],"angular_velocity":null}'
    how = (
        'To answer: [{"tool": "answer", "parameters": {"answer": 1.23}}].'
        if text
        else "To answer, call `answer` with your final answer."
    )
    return (
        f"# Returns\n\nA result is JSON, for example of get_velocity: {shown}. A call that cannot be done returns one"
        f" sentence that says why, and changes nothing. {how}"
    )


def _examples(prompting: Prompting, *, text: bool) -> list[str]:
    count = {Prompting.ZERO_SHOT: 0, Prompting.ONE_SHOT: 1, Prompting.FEW_SHOT: len(EXAMPLES)}[prompting]
    if not count:
        return []
    examples = [shown(example, as_json=text) for example in EXAMPLES[:count]]
    return ["# Worked examples from other scenes\n\n" + "\n\n".join(examples)]
