"""The laboratory without its gates, for those who may know both sides: drawn worlds, sessions of twins, calls.

`measure` sees the engine through `drawn_world`: no permissions, budgets or hidden things. Everything else here goes
through the laboratory's own door, so what a check reads is what an agent would read.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

from physment_mcp.errors import RefusedCall
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.calls import call_async
from physment_mcp.world import World
from scenes import PackFiles
from scenes.protocol import Call, Reading

READING_TOOLS = tuple(tool for tool in TOOLS if tool.reads_only)
TOOL_NAMES = tuple(tool.name for tool in TOOLS)
_LOOKS = {"elastic_response": False}


def drawn_world(mjcf: str, timestep: float | None = None) -> World:
    """The world of a drawn scene at its start.

    Args:
        mjcf: The model with the drawn values in it.
        timestep: Replaces the scene's time step [s], to see how much of a value is discretisation.
    """
    return World(mjcf, timestep)


def session_of(files: PackFiles, mjcf: str) -> Session:
    """A fresh session of a pack with this model in it."""
    return Session(replace(load_scene(files.scene_id, 0, files.folder.parent), mjcf=mjcf))


def prompt_of(files: PackFiles, mjcf: str) -> str:
    """What an agent is told of a pack with this model in it."""
    return opening_prompt(session_of(files, mjcf))


def is_intervention(tool: str, arguments: Mapping[str, Any]) -> bool:
    """Whether a call changes the world: every tool but those that only read, and the answer."""
    looks = tool == "detect_collision" and arguments.get("elastic_response") is False
    return not (looks or tool == "answer" or any(tool == one.name for one in READING_TOOLS))


async def run(session: Session, asked: Call, refused: Collection[str] = ()) -> Reading:
    """Run a call as an agent's; returns its result, or `{"error": …}` where it is refused.

    Args:
        session: The episode.
        asked: The call.
        refused: Tools refused whatever the scene says.
    """
    if asked.tool in refused:
        return {"error": f"{asked.tool} is refused"}
    try:
        return (await call_async(session, asked.tool, dict(asked.arguments))).model_dump()
    except RefusedCall as refusal:
        return {"error": str(refusal)}


async def all_readings(session: Session) -> list[tuple[str, Reading]]:
    """What every tool that only reads says of every known object and pair, with the call it came from."""
    known = [one.object_id for one in session.known()]
    asked: list[Call] = []
    for tool in READING_TOOLS:
        fields = set(tool.arguments.model_fields)
        if "object_id" in fields:
            extra = {"mass": 1.0} if "mass" in fields else {}
            asked += [Call(tool.name, {"object_id": one, **extra}) for one in known]
        elif not fields:
            asked.append(Call(tool.name, {}))
    asked += [
        Call("detect_collision", {"obj1_id": one, "obj2_id": other, **_LOOKS})
        for place, one in enumerate(known)
        for other in known[place + 1 :]
    ]
    return [(f"{one.tool}({', '.join(map(str, one.arguments.values()))})", await run(session, one)) for one in asked]
