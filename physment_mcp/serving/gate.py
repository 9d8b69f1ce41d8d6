"""Which requests the host accepts: sent to which names, from which web pages, with which token.

Knows HTTP headers. Knows no episodes, no MCP and no scenes.
"""

import ipaddress
import re
import secrets
from collections.abc import Iterable

from starlette.requests import Request
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send

from physment_mcp.errors import quoted

LOOPBACK = ("127.0.0.1", "localhost", "::1")
"""Names by which only this machine can be reached."""

_PLACE = re.compile(r"(?:\[(?P<ip6>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(?::[0-9]{1,5})?", re.ASCII | re.IGNORECASE)
"""A name or an address, with or without a port: all that a Host header may contain (RFC 9110, 7.2)."""
_SCHEME = re.compile(r"[a-z][a-z0-9+.-]*://", re.ASCII | re.IGNORECASE)


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
        hosts, origins = request.headers.getlist("host"), request.headers.getlist("origin")
        if len(hosts) != 1 or _name_of(hosts[0]) not in known:
            return refuse(400, f"this host does not go by the name {quoted(', '.join(hosts))}; --allow-host adds one")
        for origin in origins:
            scheme = _SCHEME.match(origin)
            if scheme is None or _name_of(origin[scheme.end() :]) not in known:
                return refuse(403, f"pages of {quoted(origin)} may not speak to this host")
        return None


def _name_of(place: str) -> str | None:
    """The name or address in a Host header or an origin, lower case without brackets; None if it is anything more.

    Parsers of URLs are lenient, and each in its own way: they find 127.0.0.1 in `evil.example@127.0.0.1`.
    """
    found = _PLACE.fullmatch(place)
    return (found["ip6"] or found["name"]).lower() if found else None


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
