"""An episode in this process: open it, read its prompt, call its tools. No MCP and no event loop.

For trusted code only. No public name here gives access to the model, the hidden values or the world, but they are in
the same process, and Python hides nothing from code that searches for it. Give code that you do not trust a server in
another process.
"""

import functools
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import Prompting, PromptOptions, opening_prompt
from physment_mcp.session import Session
from physment_mcp.tools import Tool
from physment_mcp.tools.calls import call, tools_of

if TYPE_CHECKING:
    from mcp.server.lowlevel import Server


@dataclass(frozen=True, slots=True)
class ToolDescription:
    """The name, description and schemas of a tool, as an agent reads them."""

    name: str
    description: str
    input_schema: dict[str, Any]
    """JSON Schema of the arguments."""
    output_schema: dict[str, Any]
    """JSON Schema of the result."""


class OpenEpisode:
    """An open episode of one scene, created by `open_episode`. Use it from one thread at a time.

    Each episode has its own copy of the scene, so any number can be open. Nothing has to be closed.
    """

    __slots__ = ("_session",)

    def __init__(self, session: Session) -> None:
        self._session = session

    @property
    def scene_id(self) -> int:
        """Id of the scene."""
        return self._session.scene.public.scene_id

    @property
    def prompt(self) -> str:
        """The opening prompt: the task, the objects, and all that an agent has to know before its first call."""
        return opening_prompt(self._session)

    def prompt_for(self, budget: int, prompting: str = "zero-shot") -> str:
        """Return the opening prompt for an agent with a budget, as agents of `physment-eval` get it.

        Args:
            budget: Number of iterations that the prompt states. Whoever runs the agent counts them.
            prompting: `zero-shot`, `one-shot-cot` or `few-shot-cot`: the number of worked examples.

        Raises:
            ValueError: `prompting` is none of these.
        """
        return opening_prompt(self._session, PromptOptions(Prompting(prompting), budget=budget))

    @property
    def tools(self) -> tuple[ToolDescription, ...]:
        """The 26 tools in their published order. Those that the prompt calls unavailable are refused."""
        return deepcopy(_descriptions(tools_of(self._session)))

    @property
    def calls(self) -> int:
        """Number of tool calls so far, refused ones included."""
        return self._session.calls

    @property
    def ended(self) -> bool:
        """Whether the episode has ended, by the answer or because the calls are used up."""
        return self._session.ended

    @property
    def answer(self) -> object:
        """The argument of the tool `answer`; None before it was called."""
        return self._session.state.answer

    def call(self, tool: str, /, **arguments: Any) -> dict[str, Any]:
        """Call a tool and wait for its result.

        Args:
            tool: Name of the tool, such as `step`.
            arguments: Its arguments, by name.

        Returns:
            The result as plain data, as MCP sends it: numbers in SI units, vectors as lists.

        Raises:
            EpisodeOver: The episode has ended.
            RefusedCall: The call was refused and changed nothing; its text says why, for the agent to read.
        """
        return call(self._session, tool, arguments).model_dump(mode="json")

    def server(self) -> "Server[Any]":
        """Return an MCP server for this episode, to which you can connect a client or your own transport.

        Do not use `call` while a client's call is running.
        """
        # MCP takes longer to import than all of the laboratory, and only this method needs it.
        from physment_mcp.serving.server import build_server  # noqa: PLC0415
        from physment_mcp.serving.slot import EpisodeSlot  # noqa: PLC0415

        return build_server(EpisodeSlot(self._session))


def open_episode(
    scene_id: int, seed: int = 0, *, max_calls: int | None = None, scenes_dir: Path | None = None
) -> OpenEpisode:
    """Open an episode of a scene.

    Args:
        scene_id: Id of the scene, such as 7.
        seed: 0 for the scene as written; any other whole number for a variant with other hidden values.
        max_calls: Limit on calls, refused ones included; None for no limit.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        SceneError: There is no such scene, or its pack is malformed.
    """
    return OpenEpisode(Session(load_scene(scene_id, seed, scenes_dir), max_calls=max_calls))


@functools.cache
def _descriptions(tools: tuple[Tool[Any], ...]) -> tuple[ToolDescription, ...]:
    return tuple(
        ToolDescription(tool.name, tool.description, tool.input_schema(), tool.output_schema()) for tool in tools
    )
