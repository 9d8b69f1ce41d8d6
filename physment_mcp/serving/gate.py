"""Which requests the host accepts: sent to which names, from which web pages, with which token.

Knows HTTP headers. Knows no episodes, no MCP and no scenes.
"""

import ipaddress
import secrets
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from physment_mcp.errors import quoted

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Names by which only this machine can be reached."""


class AddressGate:
    """Refuses requests that name another host or come from a web page of another site.

    A page in a browser on this machine can make its own host name resolve to our address (DNS rebinding); its requests
    then name that host. The address that the connection was made to cannot be forged in this way, so it is accepted.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str] = ()) -> None:
        """Set up.

        Args:
            app: The application behind the gate.
            names: Names that it accepts besides its addresses and loopback.
        """
        self._app = app
        self._names = frozenset(name.lower() for name in (*LOOPBACK, *names))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it: 400 for the wrong Host, 403 for the wrong Origin."""
        refusal = None
        if scope["type"] == "http":
            # White space after a value does not belong to it (RFC 9110, 5.5), but httptools leaves it there.
            scope["headers"] = [(name, value.rstrip(b" \t")) for name, value in scope["headers"]]
            refusal = self._refusal(Request(scope))
        await (refusal or self._app)(scope, receive, send)

    def _refusal(self, request: Request) -> JSONResponse | None:
        address = (request.scope.get("server") or (None,))[0]
        known = self._names if address is None else self._names | {address.lower()}
        host = request.headers.get("host", "")
        if _host_of(f"//{host}") not in known:
            return refuse(400, f"this host does not go by the name {quoted(host)}; --allow-host adds one")
        origin = request.headers.get("origin")
        if origin is not None and _host_of(origin) not in known:
            return refuse(403, f"pages of {quoted(origin)} may not speak to this host")
        return None


def _host_of(url: str) -> str | None:
    """The host of a URL, in lower case and without brackets; None if the URL has none or has more than a host."""
    try:
        parts = urlsplit(url)
        _ = parts.port  # raises ValueError if the port is not a number
    except ValueError:
        return None
    bare = not (parts.path or parts.query or parts.fragment or "@" in parts.netloc)
    return parts.hostname if bare else None


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach a server that listens on this address."""
    if address == "localhost":
        return True
    try:
        return ipaddress.ip_address(address.strip("[]")).is_loopback
    except ValueError:
        return False


def has_token(request: Request, *tokens: str | None) -> bool:
    """Whether a request has one of these bearer tokens; None never matches."""
    scheme, _, shown = request.headers.get("authorization", "").partition(" ")
    given = shown.strip().encode()
    # Every token is compared, each in constant time, so the duration reveals nothing about them.
    matches = [secrets.compare_digest(given, token.encode()) for token in tokens if token]
    return scheme.lower() == "bearer" and any(matches)


def refuse(status: int, sentence: str) -> JSONResponse:
    """A response that refuses with a sentence; with status 401 it asks for a bearer token."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"error": sentence}, status_code=status, headers=headers)
