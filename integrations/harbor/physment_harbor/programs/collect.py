"""Writes the call log of the episode to a file, in the laboratory's container, after the agent's container stopped.

collect.py FILE
"""

import json
import os
import sys
import urllib.request
from pathlib import Path
from typing import Any

URL = f"http://127.0.0.1:{os.environ.get('PHYSMENT_PORT', '8000')}/episodes/0/calls"


def main(file: str) -> None:
    """Read all pages of the log, and write them as one."""
    token = Path(__file__).with_name("token").read_text(encoding="ascii").strip()
    log: dict[str, Any] = {"ended": False, "calls": []}
    while True:
        request = urllib.request.Request(  # noqa: S310 - this container
            f"{URL}?start={len(log['calls'])}", headers={"Authorization": f"Bearer {token}"}
        )
        with urllib.request.urlopen(request, timeout=60) as reply:  # noqa: S310 - as above
            page = json.load(reply)
        log["ended"] = page["ended"]
        if not page["calls"]:
            break
        log["calls"] += page["calls"]
    Path(file).write_text(json.dumps(log), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
