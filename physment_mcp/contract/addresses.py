"""Loopback names, and parsing of host names in request headers."""

import ipaddress
import re

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
"""Host names and addresses that only programs on this machine can reach."""

_PLACE = re.compile(r"(?:\[(?P<ip6>[0-9a-f:.]+)\]|(?P<name>[a-z0-9._-]+))(?::[0-9]{1,5})?", re.ASCII | re.IGNORECASE)
"""A name or an address, with or without a port: all that a Host header may contain (RFC 9110, 7.2)."""


def named_host(place: str) -> str | None:
    """Parse the host in a Host header or an origin: lower case, without port and brackets; None if it is malformed.

    URL parsers are too lenient for this check: they find 127.0.0.1 in `evil.example@127.0.0.1`.
    """
    found = _PLACE.fullmatch(place)
    return (found["ip6"] or found["name"]).lower() if found else None


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach a server that listens on this address."""
    try:
        return ipaddress.ip_address(address.strip("[]")).is_loopback
    except ValueError:
        return address in LOOPBACK
