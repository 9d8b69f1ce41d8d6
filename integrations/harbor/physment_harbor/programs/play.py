"""Makes the tool calls that a file lists, over MCP. Standard library only.

play.py URL FILE    FILE holds [{"tool": "step", "arguments": {"duration": 1}}, …]
"""

import json
import sys
import urllib.request
from pathlib import Path
from typing import Any

PROTOCOL = "2025-11-25"


class McpSession:
    """A session with an MCP server over streamable HTTP."""

    def __init__(self, url: str) -> None:
        """Open the session."""
        self._url = url
        self._headers = {"Content-Type": "application/json", "Accept": "application/json, text/event-stream"}
        self._number = 0
        client = {"name": "calls", "version": "1"}
        self.ask("initialize", {"protocolVersion": PROTOCOL, "capabilities": {}, "clientInfo": client})
        self._headers["Mcp-Protocol-Version"] = PROTOCOL
        self._send({"jsonrpc": "2.0", "method": "notifications/initialized"})

    def ask(self, method: str, params: dict[str, Any]) -> dict[str, Any]:
        """Send a request and return its result."""
        self._number += 1
        text = self._send({"jsonrpc": "2.0", "id": self._number, "method": method, "params": params})
        # A reply is one JSON object, or a stream of events, the last of which contains the object.
        lines = [line.removeprefix("data:") for line in text.splitlines() if line.startswith(("data:", "{"))]
        found = [message for message in map(json.loads, filter(str.strip, lines)) if message.get("id") == self._number]
        if not found or "result" not in found[0]:
            sys.exit(f"{method} was not answered: {text[:500]}")
        return found[0]["result"]

    def _send(self, message: dict[str, Any]) -> str:
        request = urllib.request.Request(self._url, json.dumps(message).encode(), self._headers)  # noqa: S310 - the task's
        with urllib.request.urlopen(request, timeout=600) as reply:  # noqa: S310 - as above
            if session := reply.headers.get("Mcp-Session-Id"):
                self._headers["Mcp-Session-Id"] = session
            return reply.read().decode()


def main(url: str, file: str) -> None:
    """Make all calls; stop at the first refused call."""
    laboratory = McpSession(url)
    for call in json.loads(Path(file).read_text(encoding="utf-8")):
        result = laboratory.ask("tools/call", {"name": call["tool"], "arguments": call["arguments"]})
        text = " ".join(part.get("text", "") for part in result["content"])
        print(call["tool"], text[:200], flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
