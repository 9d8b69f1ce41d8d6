"""Live servers withstand malformed frames, and the checks detect a server that does not."""

import random
import sys

import pytest

from physment_mcp.serving.http_guard import fault_of
from tests.harness.fuzz.frames import draw_frame, over_http, over_stdio, play

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the state of the host is found in /proc")


async def test_a_host_withstands_spoiled_frames() -> None:
    assert await over_http(200, seed=20260102) == []


async def test_a_server_on_stdio_withstands_spoiled_frames() -> None:
    assert await over_stdio(200, seed=20260102) == []


def test_frames_are_of_every_kind() -> None:
    source = random.Random(1)
    drawn = [draw_frame(source) for _ in range(2000)]
    faults = [fault_of(frame) for frame in drawn]
    # Some frames are refused because they are not JSON or not a message; the others are passed to the library.
    assert {fault.code for fault in faults if fault} == {-32700, -32600}
    assert 300 < faults.count(None) < 1700
    for needed in (b"NaN", b"1e400", b"\xff", b"[{", b"notifications/", b"\\ud800"):
        assert any(needed in frame for frame in drawn)
    assert draw_frame(random.Random(7)) == draw_frame(random.Random(7))


@pytest.mark.parametrize(
    "reply", [b'{"error": "Traceback (most recent call last)"}', b'see File "/x/y"', b"pydantic.dev"]
)
async def test_a_reply_about_the_inside_of_the_program_is_noticed(reply: bytes) -> None:
    async def send(_frame: bytes) -> bytes:
        return reply

    async def honest() -> int:
        return 1

    assert len(await play(100, random.Random(1), send, honest)) == 3


async def test_a_frame_that_changes_something_and_a_server_that_ends_are_noticed() -> None:
    sent: list[bytes] = []

    async def send(frame: bytes) -> bytes:
        sent.append(frame)
        return b"{}"

    async def counts() -> int:
        return len(sent)

    async def ends() -> int:
        if sent:
            raise ConnectionResetError("gone")
        return 1

    assert "an honest call says 20, not 0" in (await play(100, random.Random(1), send, counts))[0]
    sent.clear()
    (problem,) = await play(100, random.Random(1), send, ends)
    assert problem.startswith("ConnectionResetError gone after one of")
