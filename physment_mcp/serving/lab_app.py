"""An app that draws the visible bodies in chat clients that show apps (MCP Apps, 2026-01-26).

A client declares the extension `io.modelcontextprotocol/ui` for HTML. It then finds the address of the app in the tools
that change what may be seen, reads it as a resource, and passes it the results of these tools. The app draws the data
in their `_meta`, which no model reads. Other clients get none of this. Neither do programs that play an episode for a
score, because they could measure without calls.
"""

import functools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mcp_types as types

from physment_mcp.contract.names import APP_TYPE, APPS, VIEW_URI
from physment_mcp.serving.resources import FRESH_MS, ICON
from physment_mcp.tools.act import CHANGE_POSITION, MOVE_OBJECT
from physment_mcp.tools.edit import CREATE_OBJECTS, DELETE_OBJECTS, FIND_OBJECTS
from physment_mcp.tools.episode import STEP

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
    content = types.TextResourceContents(uri=APP_URI, mime_type=APP_TYPE, text=_page(), _meta=_APP_META)
    return types.ReadResourceResult(contents=[content], ttl_ms=FRESH_MS, cache_scope="public")


def view_page(view: Mapping[str, Any] | None) -> types.ReadResourceResult:
    """Return a view as the content of a resource; an empty view if nothing is visible."""
    text = json.dumps(view or {"time": 0.0, "drawing": {"bodies": []}, "poses": {}})
    content = types.TextResourceContents(uri=VIEW_URI, mime_type="application/json", text=text)
    return types.ReadResourceResult(contents=[content], ttl_ms=0, cache_scope="private")


@functools.cache
def _page() -> str:
    return _FILE.read_text(encoding="utf-8")
