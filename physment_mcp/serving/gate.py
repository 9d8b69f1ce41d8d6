"""Who may speak to the host: which names it answers to, from which pages, and with which token.

Knows HTTP headers. Knows no episodes, no MCP and no scenes.
"""

import ipaddress
import secrets
from collections.abc import Iterable
from urllib.parse import urlsplit

from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Names of this machine that lead nowhere else."""


class AddressGate:
    """Refuses requests that were meant for another name or come from a page of another site.

    A page in a browser on this machine can have a name of its own resolved to our address (DNS rebinding); its requests
    then bear that name. The address a connection was really made to cannot be bent in this way, so it is good too.
    """

    def __init__(self, app: ASGIApp, names: Iterable[str] = ()) -> None:
        """Args: the application behind the gate, and names it answers to besides its addresses and loopback."""
        self._app = app
        self._names = frozenset(name.lower() for name in (*LOOPBACK, *names))

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it: 400 for the wrong Host, 403 for the wrong Origin."""
        refusal = None
        if scope["type"] == "http":
            # White space after a value is no part of it (RFC 9110, 5.5), but httptools leaves it there.
            scope["headers"] = [(name, value.rstrip(b" \t")) for name, value in scope["headers"]]
            refusal = self._refusal(Request(scope))
        await (refusal or self._app)(scope, receive, send)

    def _refusal(self, request: Request) -> JSONResponse | None:
        address = (request.scope.get("server") or (None,))[0]
        known = self._names if address is None else self._names | {address.lower()}
        host = request.headers.get("host", "")
        if _host_of(f"//{host}") not in known:
            return refuse(400, f"this host does not go by the name {host!r}; serve it with --allow-host to let it")
        origin = request.headers.get("origin")
        if origin is not None and _host_of(origin) not in known:
            return refuse(403, f"pages of {origin!r} may not speak to this host")
        return None


def _host_of(url: str) -> str | None:
    """The host a URL names, lower case and without brackets; None if it names none."""
    try:
        parts = urlsplit(url)
        _ = parts.port  # raises where it is none
    except ValueError:
        return None
    bare = not (parts.path or parts.query or parts.fragment or "@" in parts.netloc)
    return parts.hostname if bare else None


def is_loopback(address: str) -> bool:
    """Tell whether only this machine can reach an address to listen on."""
    if address == "localhost":
        return True
    try:
        return ipaddress.ip_address(address.strip("[]")).is_loopback
    except ValueError:
        return False


def bears(request: Request, *tokens: str | None) -> bool:
    """Tell whether a request bears one of these tokens; None is no token, which nothing bears."""
    scheme, _, shown = request.headers.get("authorization", "").partition(" ")
    given = shown.strip().encode()
    # All are compared, and each in constant time, so that how long it takes tells nothing.
    matches = [secrets.compare_digest(given, token.encode()) for token in tokens if token]
    return scheme.lower() == "bearer" and any(matches)


def refuse(status: int, sentence: str) -> JSONResponse:
    """A refusal: its sentence, and for 401 the way to do better."""
    headers = {"WWW-Authenticate": "Bearer"} if status == 401 else None
    return JSONResponse({"error": sentence}, status_code=status, headers=headers)
