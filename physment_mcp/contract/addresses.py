"""Host names and addresses that only programs on this machine can reach."""

import ipaddress

LOOPBACK = frozenset({"127.0.0.1", "localhost", "::1"})
"""Host names and addresses that only programs on this machine can reach."""


def is_loopback(address: str) -> bool:
    """Whether only this machine can reach a server that listens on this address."""
    try:
        return ipaddress.ip_address(address.strip("[]")).is_loopback
    except ValueError:
        return address in LOOPBACK
