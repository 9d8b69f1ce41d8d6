"""Tests of the middleware that refuses requests whose Host header does not name this machine."""

import httpx
import pytest
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route

from physment_mcp.contract.request_origin import OnlyHere
from tests.builders.hosts import FOREIGN_HOSTS


async def page(_request: Request) -> PlainTextResponse:
    return PlainTextResponse("for you")


async def asked(*hosts: str) -> httpx.Response:
    """Return the response to a request with these Host headers."""
    guarded = Starlette(
        routes=[Route("/", page)], middleware=[Middleware(OnlyHere, headers={b"x-frame-options": b"DENY"})]
    )
    transport = httpx.ASGITransport(guarded)
    async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1") as http:
        return await http.get("/", headers=[(b"Host", name.encode("latin-1")) for name in hosts])


@pytest.mark.parametrize("name", FOREIGN_HOSTS)
async def test_a_request_that_names_another_host_is_refused(name: str) -> None:
    refused = await asked(name)
    assert (refused.status_code, refused.json()) == (403, {"error": "this page is for this machine alone"})


@pytest.mark.parametrize("names", [("localhost", "evil.example"), ("evil.example", "localhost"), ("localhost",) * 2])
async def test_a_request_with_two_names_is_refused(names: tuple[str, str]) -> None:
    assert (await asked(*names)).status_code == 403


@pytest.mark.parametrize("name", ["127.0.0.1:8000", "localhost", "LOCALHOST:1", "[::1]:8000", "[::1]"])
async def test_a_request_that_names_this_machine_is_served(name: str) -> None:
    served = await asked(name)
    assert (served.text, served.headers["x-frame-options"]) == ("for you", "DENY")
