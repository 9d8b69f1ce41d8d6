"""The picture clients show beside our name: a ball on a ramp."""

import base64
from importlib.resources import files

import mcp_types as types

_PICTURES = files("physment_mcp.serving") / "icons"

LARGE_PNG = (_PICTURES / "512.png").read_bytes()
"""The picture for a page of a catalogue, 512 × 512."""
# In the URL itself, so that no client fetches anything; small, because the protocol sends it with every result.
ICON = types.Icon(
    src="data:image/png;base64," + base64.b64encode((_PICTURES / "32.png").read_bytes()).decode("ascii"),
    mime_type="image/png",
    sizes=["32x32"],
)
