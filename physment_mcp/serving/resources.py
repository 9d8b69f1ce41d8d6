"""The resources that MCP clients can read: the scenes, the open scene, the state of its episode, the measurements.

They contain only information that the agent has already received. Reading them changes nothing and is not a call.

One resource is an app that draws the visible bodies in chat clients that show apps (MCP Apps, 2026-01-26). A client
declares the extension `io.modelcontextprotocol/ui` for HTML. It then finds the address of the app in the tools that
change what may be seen, reads it, and passes it the results of these tools. The app draws the data in their `_meta`,
which no model reads. Other clients get none of this. Neither do programs that play an episode for a score, because they
could measure without calls.
"""

import base64
import functools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import mcp_types as types

from physment_mcp.contract.names import APP_TYPE, APPS, SCENE_URI, VIEW_URI
from physment_mcp.errors import quoted
from physment_mcp.serving.slot import MAX_PAGE_BYTES, EpisodeSlot, LoggedCall
from physment_mcp.session import Session
from physment_mcp.tools.act import CHANGE_POSITION, MOVE_OBJECT
from physment_mcp.tools.edit import CREATE_OBJECTS, DELETE_OBJECTS, FIND_OBJECTS
from physment_mcp.tools.episode import STEP
from scenes import AnswerForm

APP_URI = "ui://physment/lab"
SHOWING = frozenset(
    tool.name for tool in (STEP, MOVE_OBJECT, CHANGE_POSITION, CREATE_OBJECTS, DELETE_OBJECTS, FIND_OBJECTS)
)
"""Tools that change what may be seen."""
_FILE = Path(__file__).parent / "lab.html"
"""Built from `viewer/` by `make viewer`."""
_NOWHERE: list[str] = []
_APP_META = {
    "ui": {
        "csp": dict.fromkeys(("connectDomains", "resourceDomains", "frameDomains", "baseUriDomains"), _NOWHERE),
        "prefersBorder": True,
    }
}
"""Metadata of the app: it needs no other page, file or permission."""


def shows_apps(capabilities: types.ClientCapabilities | None) -> bool:
    """Return whether a client declares that it shows apps in HTML."""
    declared = None if capabilities is None else capabilities.extensions
    kinds = (declared or {}).get(APPS, {}).get("mimeTypes")
    return isinstance(kinds, list) and APP_TYPE in kinds


def with_app(tools: tuple[types.Tool, ...]) -> list[types.Tool]:
    """Return the tools for a client that shows apps: some carry the app's address, also under the older, flat key."""
    meta = {"ui": {"resourceUri": APP_URI}, "ui/resourceUri": APP_URI}
    return [tool.model_copy(update={"meta": meta}) if tool.name in SHOWING else tool for tool in tools]


def app_resources() -> list[types.Resource]:
    """Return the resources that are listed only for clients that show apps."""
    return [
        types.Resource(
            uri=APP_URI,
            name="lab",
            title="The laboratory",
            description="Draws what may be seen, and plays the motion of the last step.",
            mime_type=APP_TYPE,
            icons=[ICON],
            _meta=_APP_META,
        ),
        types.Resource(
            uri=VIEW_URI,
            name="view",
            title="What may be seen now",
            description="Shapes and poses of what may be seen, for the app that draws them. Reading it is no call.",
            mime_type="application/json",
            icons=[ICON],
        ),
    ]


def app_page() -> types.ReadResourceResult:
    """Return the app as the content of a resource."""
    content = types.TextResourceContents(uri=APP_URI, mime_type=APP_TYPE, text=_app_html(), _meta=_APP_META)
    return types.ReadResourceResult(contents=[content], ttl_ms=FRESH_MS, cache_scope="public")


def view_page(view: Mapping[str, Any] | None) -> types.ReadResourceResult:
    """Return a view as the content of a resource; an empty view if nothing is visible."""
    text = json.dumps(view or {"time": 0.0, "drawing": {"bodies": []}, "poses": {}})
    content = types.TextResourceContents(uri=VIEW_URI, mime_type="application/json", text=text)
    return types.ReadResourceResult(contents=[content], ttl_ms=0, cache_scope="private")


@functools.cache
def _app_html() -> str:
    return _FILE.read_text(encoding="utf-8")


_PICTURES = files("physment_mcp.serving") / "icons"

LARGE_PNG = (_PICTURES / "512.png").read_bytes()
"""The picture for catalogues, 512 × 512 pixels."""
# A data URL, so that clients fetch nothing; small, because the protocol sends it with every result.
ICON = types.Icon(
    src="data:image/png;base64," + base64.b64encode((_PICTURES / "32.png").read_bytes()).decode("ascii"),
    mime_type="image/png",
    sizes=["32x32"],
)
MAX_URI = 200
"""Largest number of characters of an unknown address that an error message quotes."""
FRESH_MS = 3_600_000
"""Time for which a client may cache content that never changes [ms]."""
_MEASUREMENTS_FROM = "physment://measurements/"


@dataclass(frozen=True, slots=True)
class _View:
    """A resource and the function that creates its content."""

    name: str
    title: str
    description: str
    write: Callable[[EpisodeSlot], dict[str, Any] | str]
    """Creates the content: an object, or its JSON text."""
    settled: bool
    """Whether the content never changes, as long as no other scene can be opened."""


def _scenes(slot: EpisodeSlot) -> dict[str, Any]:
    shown = ("scene_id", "name", "problem_type", "task")
    return {"scenes": [{name: getattr(scene, name) for name in shown} for scene in slot.catalogue]}


def _scene(slot: EpisodeSlot) -> dict[str, Any]:
    return _nothing_open(slot) if slot.session is None else _scene_view(slot.session)


def _episode(slot: EpisodeSlot) -> dict[str, Any]:
    return _nothing_open(slot) if slot.session is None else _episode_view(slot.session)


def _measurements(slot: EpisodeSlot) -> str:
    page = slot.log.newest_page()
    return _page(page, slot.log.left_out + len(slot.log.calls) - len(page))


def _measurements_from(slot: EpisodeSlot, call: int) -> str:
    first = max(0, call - 1 - slot.log.left_out)
    return _page(slot.log.page_from(first), slot.log.left_out + first)


def _page(calls: Sequence[LoggedCall], before: int) -> str:
    notes = ", ".join(logged.as_note(number) for number, logged in enumerate(calls, before + 1))
    return f'{{"left_out": {before}, "calls": [{notes}]}}'


def _nothing_open(slot: EpisodeSlot) -> dict[str, Any]:
    return {"phase": "idle"} if slot.gone is None else {"phase": "gone", "why": slot.gone}


def _scene_view(session: Session) -> dict[str, Any]:
    scene, form = session.scene.public, session.scene.public.answer_form
    return {
        "scene_id": scene.scene_id,
        "name": scene.name,
        "task": scene.task,
        "problem_type": scene.problem_type,
        "objects": [{"object_id": item.object_id, "name": item.name, **look} for item, look in session.opening],
        "answer": form and _answer_view(form),
        **({"steps": [step.model_dump() for step in scene.steps]} if scene.steps else {}),
        **({"law_answer": True} if scene.law_answer else {}),
        "disabled_tools": sorted(scene.disabled_tools),
        "timestep_s": session.world.timestep,
    }


def _answer_view(form: AnswerForm) -> dict[str, Any]:
    view = {"kind": form.kind, "unit": form.unit, "labels": form.labels, "options": form.options}
    return {**view, "variables": form.model_dump()["variables"]} if form.variables else view


def _episode_view(session: Session) -> dict[str, Any]:
    return {
        "phase": "answered" if session.state.answered else "ended" if session.ended else "running",
        "sim_time": session.world.time,
        "calls": session.calls,
        **({} if session.max_calls is None else {"max_calls": session.max_calls}),
        "objects": [item.object_id for item in session.known()],
    }


_VIEWS = {
    SCENE_URI: _View(
        "scene", "The open scene", "Task, objects and form of the answer, as in the prompt.", _scene, settled=True
    ),
    "physment://episode": _View(
        "episode", "Where the episode stands", "Phase, clock, calls so far, known objects.", _episode, settled=False
    ),
    "physment://measurements": _View(
        "measurements",
        "What was measured",
        f"The calls of this episode and their results, the newest {MAX_PAGE_BYTES // 1000} kB of them.",
        _measurements,
        settled=False,
    ),
    "physment://scenes": _View(
        "scenes", "The scenes", "Number, name and task of each scene that can be opened here.", _scenes, settled=True
    ),
}


def listed_resources() -> list[types.Resource]:
    """The resources as MCP publishes them."""
    return [
        types.Resource(
            uri=uri,
            name=view.name,
            title=view.title,
            description=view.description,
            mime_type="application/json",
            icons=[ICON],
        )
        for uri, view in _VIEWS.items()
    ]


def listed_templates() -> list[types.ResourceTemplate]:
    """The resource templates as MCP publishes them."""
    return [
        types.ResourceTemplate(
            uri_template=_MEASUREMENTS_FROM + "{call}",
            name="measurements-from",
            title="What was measured, from a call on",
            description=f"The calls from this number on, counted from 1, at most {MAX_PAGE_BYTES // 1000} kB of them.",
            mime_type="application/json",
            icons=[ICON],
        )
    ]


def read(slot: EpisodeSlot, uri: str) -> types.ReadResourceResult:
    """Return the present content of a resource, and how long a client may cache it.

    Raises:
        LookupError: There is no such resource; the message lists all resources.
    """
    view = _VIEWS.get(uri)
    if view is not None:
        return _result(uri, view.write(slot), FRESH_MS if view.settled and slot.fixed else 0)
    call = uri.removeprefix(_MEASUREMENTS_FROM)
    if call != uri and call.isdecimal() and len(call) < 10:
        return _result(uri, _measurements_from(slot, int(call)), 0)
    raise LookupError(f"there is no resource {quoted(uri)}; the resources are {', '.join(_VIEWS)}")


def _result(uri: str, content: dict[str, Any] | str, ttl_ms: int) -> types.ReadResourceResult:
    text = content if isinstance(content, str) else json.dumps(content, ensure_ascii=False)
    return types.ReadResourceResult(
        contents=[types.TextResourceContents(uri=uri, mime_type="application/json", text=text)],
        ttl_ms=ttl_ms,
        cache_scope="private",
    )
