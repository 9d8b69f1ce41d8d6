"""A process that draws: models and views on stdin, one JSON line each, pictures on stdout, one line of base64 each.

An empty line says that nothing could be drawn; the first line answers before anything is asked whether anything can.
"""

import base64
import json
import os
import sys

import numpy as np

from physment_mcp.world.pictures.drawing import Visible, check_renderer, drawn, staged
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.png import png_of


def main() -> int:
    """Draw until stdin ends."""
    # Graphics libraries write where they like: the pipe is for pictures.
    replies = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)
    try:
        check_renderer()
    except Exception:  # noqa: BLE001 - each library fails in its own way
        return 1
    print("ready", file=replies, flush=True)
    for line in sys.stdin:
        print(_drawn(line), file=replies, flush=True)
    return 0


def _drawn(request: str) -> str:
    wanted = json.loads(request)
    try:
        model, data = staged(wanted["mjcf"], Visible((), ()))
        model.geom_group[:] = 0
        pixels = drawn(model, data, View(np.array(wanted["centre"]), wanted["distance"], wanted["extent"]))
    except Exception:  # noqa: BLE001 - as above; a picture less is no reason to end
        return ""
    return base64.b64encode(png_of(pixels)).decode("ascii")


if __name__ == "__main__":
    sys.exit(main())
