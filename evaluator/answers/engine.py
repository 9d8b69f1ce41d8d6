"""Privileged access of the evaluator to the physics engine.

Only three modules or packages may import this module: `answers/keys`, for keys without a closed form; `certify/`, to
certify scenes; and `commands/scenes`, to print a prompt. It loads MuJoCo and the server's code, which are not needed to
play an episode or to grade a scene that has a `theory`.

`Engine` bypasses permissions, budgets and hiding. The other functions use a session and its tools, and so return what
an agent would read.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import combinations
from typing import Any

from evaluator.errors import UsageError
from physment_mcp.errors import RefusedCall, SceneError
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import CallProtocol, Prompting, PromptOptions, opening_prompt
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.calls import call_async
from physment_mcp.world import World
from scenes import PackFiles, Scalar, changed_mjcf
from scenes.protocol import Call, Reading

READING_TOOLS = tuple(tool for tool in TOOLS if tool.reads_only)
TOOL_NAMES = tuple(tool.name for tool in TOOLS)
_LOOK_ONLY = {"elastic_response": False}
"""Arguments with which `detect_collision` does not change the state."""


class Engine(World):
    """The world of a sampled scene in its initial state, without permissions, limits or instrument resolution."""

    def __init__(self, mjcf: str, timestep: float | None = None) -> None:
        """Compile the model.

        Args:
            mjcf: The MJCF model with the sampled values.
            timestep: Time step to use in place of the scene's [s], to measure the discretisation error.
        """
        super().__init__(mjcf, timestep)
        self._mjcf, self._halved = mjcf, timestep

    def changed(
        self, changes: Mapping[str, Scalar | tuple[Scalar, ...]] | None = None, without: Collection[str] = ()
    ) -> "Engine":
        """Return the initial state of the scene with a changed apparatus, even one that no agent could build.

        Args:
            changes: Target as in `apply` of a pack, such as `joint[rail].frictionloss` → new value. A mass must name
                the element that holds it, such as `body[object_1]/inertial.mass`.
            without: Elements to remove, such as `joint[stop]`.

        Raises:
            ValueError: A target does not name exactly one element.
            SceneError: The changed model does not compile.
        """
        return Engine(changed_mjcf(self._mjcf, changes or {}, without), self._halved)


def session_of(files: PackFiles, mjcf: str, *, any_calls: bool = False) -> Session:
    """Start a session of a pack with a given model.

    Args:
        files: The pack.
        mjcf: The MJCF model with the sampled values.
        any_calls: Whether to ignore the scene's limit on calls.
    """
    scene = replace(load_scene(files.scene_id, 0, files.folder.parent), mjcf=mjcf)
    limits = scene.public.limits
    if any_calls and limits is not None:
        public = scene.public.model_copy(update={"limits": limits.model_copy(update={"calls": None})})
        scene = replace(scene, public=public)
    return Session(scene)


def prompt_of(
    files: PackFiles, mjcf: str, prompting: str = "zero-shot", protocol: str = "native", budget: int | None = None
) -> str:
    """Return the opening prompt of a pack with a given model.

    Args:
        files: The pack.
        mjcf: The MJCF model with the sampled values.
        prompting: Value of `run --prompting`.
        protocol: Value of `run --protocol`.
        budget: Number of iterations that the prompt mentions; None to mention none.

    Raises:
        UsageError: The server rejects the pack or the model.
    """
    try:
        session = session_of(files, mjcf)
    except SceneError as error:
        raise UsageError(f"scene {files.scene_id} cannot be opened: {error}") from error
    return opening_prompt(session, PromptOptions(Prompting(prompting), CallProtocol(protocol), budget))


def is_intervention(tool: str, arguments: Mapping[str, Any]) -> bool:
    """Whether a call changes the state of the world. Reading tools and `answer` do not."""
    only_looks = tool == "detect_collision" and arguments.get("elastic_response") is False
    return not (only_looks or tool == "answer" or any(tool == reading.name for reading in READING_TOOLS))


async def run(session: Session, asked: Call, refused: Collection[str] = ()) -> Reading:
    """Run a call with an agent's permissions; return its result, or `{"error": …}` if it is refused.

    Args:
        session: Session of the episode.
        asked: The call to run.
        refused: Tools to refuse even if the scene allows them.
    """
    if asked.tool in refused:
        return {"error": f"{asked.tool} is refused"}
    try:
        return (await call_async(session, asked.tool, dict(asked.arguments))).model_dump()
    except RefusedCall as refusal:
        return {"error": str(refusal)}


async def all_readings(session: Session) -> list[tuple[str, Reading]]:
    """Return the result of every reading tool for every known object and pair of objects, each with its call."""
    known = [listed.object_id for listed in session.known()]
    calls: list[Call] = []
    for tool in READING_TOOLS:
        fields = set(tool.arguments.model_fields)
        if "object_id" in fields:
            extra = {"mass": 1.0} if "mass" in fields else {}
            calls += [Call(tool.name, {"object_id": object_id, **extra}) for object_id in known]
        elif not fields:
            calls.append(Call(tool.name, {}))
    calls += [
        Call("detect_collision", {"obj1_id": first, "obj2_id": second, **_LOOK_ONLY})
        for first, second in combinations(known, 2)
    ]
    return [
        (f"{asked.tool}({', '.join(map(str, asked.arguments.values()))})", await run(session, asked)) for asked in calls
    ]
