"""The picture that clients show beside the name of the server: a ball on a ramp."""

import base64
from importlib.resources import files

import mcp_types as types

_PICTURES = files("physment_mcp.serving") / "icons"

LARGE_PNG = (_PICTURES / "512.png").read_bytes()
"""The picture for catalogues, 512 × 512 pixels."""
# A data URL, so that clients fetch nothing; small, because the protocol sends it with every result.
ICON = types.Icon(
    src="data:image/png;base64," + base64.b64encode((_PICTURES / "32.png").read_bytes()).decode("ascii"),
    mime_type="image/png",
    sizes=["32x32"],
)
