"""Tool calls of an episode, one stateless POST each (MCP 2026-07-28). Standard library only.

`Laboratory` is for synchronous code. Asynchronous code sends the request that `request_of` returns with its own HTTP
library, and reads the reply with `result_of`.
"""

import base64
import http.client
import json
import time
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

PROTOCOL = "2026-07-28"
"""Version of MCP, the first without sessions."""
GONE = "physment/gone"
"""Key in `_meta` of a result that a host sets when it no longer has the episode."""
CONNECT_S = 30.0
"""Longest time to connect [s]."""
READ_S = 300.0
"""Longest time without a byte from the host [s]; the host sends pings during a long step."""
IDLE_S = 5.0
"""Idle time after which a connection is not used again [s]; servers close idle connections later than this."""
_META = {"io.modelcontextprotocol/protocolVersion": PROTOCOL, "io.modelcontextprotocol/clientCapabilities": {}}
_AGENT_FAULTS = (400, 413, 422)
"""Statuses with which the host refuses what the agent sent, such as arguments that are too long."""


class LaboratoryError(Exception):
    """The host cannot be reached or no longer has the episode. The agent is not at fault."""


@dataclass(frozen=True, slots=True)
class CallResult:
    """The result of a tool call."""

    text: str
    """Text for the model: the result as JSON, or the reason of a refusal."""
    content: dict[str, Any] | None
    """The result as data; None if the call was refused."""
    is_error: bool


def request_of(player_token: str, tool: str, arguments: dict[str, Any]) -> tuple[dict[str, str], bytes]:
    """Return the headers and the body of the HTTP request (POST) for a tool call."""
    headers = {
        "Authorization": f"Bearer {player_token}",
        "Content-Type": "application/json",
        "Accept": "application/json, text/event-stream",
        "MCP-Protocol-Version": PROTOCOL,
        "Mcp-Method": "tools/call",
        "Mcp-Name": _header_value(tool),
    }
    params = {"name": tool, "arguments": arguments, "_meta": _META}
    return headers, json.dumps({"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": params}).encode()


def _header_value(name: str) -> str:
    """Encode a name for an MCP header: unchanged if it is plain ASCII, otherwise in base64."""
    if name.isascii() and name.isprintable() and name == name.strip() and not name.startswith("=?"):
        return name
    return f"=?base64?{base64.b64encode(name.encode(errors='replace')).decode()}?="


def result_of(status: int, body: bytes) -> CallResult:
    """Read the reply to a call.

    Raises:
        LaboratoryError: The host failed, or no longer has the episode; the message is one sentence.
    """
    try:
        # A long call is answered by a stream of events, the last of which is the reply.
        found = json.loads(body if body[:1] == b"{" else body.rpartition(b"data: ")[2])
    except ValueError:
        found = {}
    error = found.get("error")
    if isinstance(error, dict) and "message" in error:
        return CallResult(error["message"], None, True)
    if isinstance(error, str) and status in _AGENT_FAULTS:
        return CallResult(error, None, True)
    if "result" not in found:
        raise LaboratoryError(f"the host failed: {error or f'it answered {status}'}")
    result = found["result"]
    text = "\n".join(part["text"] for part in result["content"] if part["type"] == "text")
    if GONE in (result.get("_meta") or {}):
        raise LaboratoryError(f"the host no longer has the episode: {text}")
    is_error = bool(result.get("isError"))
    return CallResult(text, None if is_error else result.get("structuredContent"), is_error)


class Laboratory:
    """Makes the calls of one episode over a persistent connection. Not thread-safe."""

    def __init__(self, mcp_url: str, player_token: str) -> None:
        """Store address and token; the first call opens the connection.

        Args:
            mcp_url: Address of the episode.
            player_token: Bearer token of its requests.
        """
        url = urlsplit(mcp_url)
        kind = http.client.HTTPSConnection if url.scheme == "https" else http.client.HTTPConnection
        self._url, self._token = mcp_url, player_token
        self._path = url.path + (f"?{url.query}" if url.query else "")
        self._connection = kind(url.hostname or "", url.port, timeout=CONNECT_S)
        self._used_at = 0.0

    def call(self, tool: str, arguments: dict[str, Any]) -> CallResult:
        """Call a tool.

        Raises:
            LaboratoryError: The host cannot be reached or no longer has the episode. The call is not repeated, because
                it may have been run.
        """
        headers, body = request_of(self._token, tool, arguments)
        try:
            self._connect()
            self._connection.request("POST", self._path, body, headers)
            reply = self._connection.getresponse()
            status, content = reply.status, reply.read()
            self._used_at = time.monotonic()
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise LaboratoryError(f"the host at {self._url} cannot be reached ({error!r})") from error
        return result_of(status, content)

    def _connect(self) -> None:
        """Connect, if there is no connection or it has been idle for so long that the host may have closed it."""
        if time.monotonic() - self._used_at > IDLE_S:
            self.close()
        if self._connection.sock is None:
            self._connection.connect()
            self._connection.sock.settimeout(READ_S)

    def close(self) -> None:
        """Close the connection. This does not end the episode."""
        self._connection.close()
