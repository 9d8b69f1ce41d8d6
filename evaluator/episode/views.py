"""What may be seen in an episode, for who shows it: how a client asks for it, and where results carry it.

It travels beside the text of results, which is all that is recorded. Reading it is no call.
"""

import json
from collections.abc import Mapping
from typing import Any, cast

import mcp_types as types
from mcp import Client
from mcp.client.extension import ClientExtension, advertise
from mcp.shared.exceptions import MCPError

from physment_mcp.contract.names import APP_TYPE, APPS, VIEW, VIEW_URI


def shows_views() -> ClientExtension:
    """What a client declares that shows what may be seen, as chat clients do (MCP Apps)."""
    return advertise(APPS, {"mimeTypes": [APP_TYPE]})


def view_in(result: types.CallToolResult) -> dict[str, Any] | None:
    """The view that came with a result; None if none did."""
    found: object = (result.meta or {}).get(VIEW)
    return cast(dict[str, Any], found) if isinstance(found, dict) else None


def joined(before: Mapping[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """The later of two views; its motion begins with that of the earlier one if it goes on from there."""
    first, second = before.get("motion"), after.get("motion")
    if not first or not second or first["times"][-1] != second["times"][0]:
        return after
    poses: dict[str, Any] = {}
    for name in first["poses"] | second["poses"]:
        # An object that rested is not listed in a motion.
        early = first["poses"].get(name) or [second["poses"][name][0]] * len(first["times"])
        late = second["poses"].get(name) or [early[-1]] * len(second["times"])
        poses[name] = [*early, *late[1:]]
    return after | {"motion": {"times": [*first["times"], *second["times"][1:]], "poses": poses}}


async def view_now(client: Client) -> dict[str, Any] | None:
    """What may be seen now; None if the server does not tell."""
    try:
        (content,) = (await client.read_resource(VIEW_URI)).contents
    except MCPError:
        return None
    return json.loads(content.text) if isinstance(content, types.TextResourceContents) else None
