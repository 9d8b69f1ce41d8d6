"""The rendering process: reads models and views from stdin as lines of JSON, writes images to stdout in base64.

It first writes `ready`, or exits if this machine cannot render. An empty line means that rendering failed.
"""

import base64
import json
import os
import sys

import numpy as np

from physment_mcp.world.pictures.drawing import check_renderer, drawn, staged
from physment_mcp.world.pictures.framing import View
from physment_mcp.world.pictures.overlay import png_of


def main() -> int:
    """Render until stdin ends."""
    # Graphics libraries write messages to stdout; send these to stderr, so that stdout carries only pictures.
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
        model, data = staged(wanted["mjcf"])
        pixels = drawn(model, data, View(np.array(wanted["centre"]), wanted["distance"], wanted["extent"]))
    except Exception:  # noqa: BLE001 - as above; the next picture may succeed
        return ""
    return base64.b64encode(png_of(pixels)).decode("ascii")


if __name__ == "__main__":
    sys.exit(main())
