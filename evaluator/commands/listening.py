"""Where commands listen, and the token in the addresses of their pages."""

import os
import secrets
import socket
import sys
import webbrowser

from evaluator.errors import UsageError


def listening(address: str, number: int) -> socket.socket:
    """A socket that listens.

    Args:
        address: On which address.
        number: On which port; 0 for any free one.

    Raises:
        UsageError: The port is taken, or the address is not of this machine.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        listener = socket.create_server((address.strip("[]"), number), family=family)
    except OSError as error:
        raise UsageError(f"cannot listen on {address} port {number}: {error.strerror}") from error
    # Otherwise the system holds small packets back, which costs 40 ms a request.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def page_token() -> str:
    """A token for the address of a page, which nobody guesses."""
    return secrets.token_urlsafe(16)


def open_page(address: str) -> None:
    """Open a page in the browser, where there is a screen: a browser in the terminal would take the terminal."""
    if sys.platform in {"win32", "darwin"} or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)
