"""The page that shows the app of the chat: over HTTP with a real server, and in headless Chromium."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests.builders.chromium import SOFTWARE_WEBGL, chromium, installed

PROGRAM = installed()


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    command = [sys.executable, "-m", "physment_mcp", "preview", "7", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        line = process.stdout.readline()
        (found,) = re.findall(r"http://127\.0\.0\.1:\d+/[\w-]+/", line)
        yield found
        process.send_signal(signal.SIGINT)


def test_the_page_calls_tools_and_reads_the_view_for_this_machine_alone(address: str) -> None:
    with httpx.Client(base_url=address, timeout=300, trust_env=False) as http:
        state = http.get("state").json()
        assert len(state["tools"]) == 26
        assert "step" in state["showing"]
        assert "get_position" not in state["showing"]
        assert "Speed of a dropped ball" in state["prompt"]
        step = http.post("call", json={"tool": "step", "arguments": {"duration": 0.8}}).json()
        assert step["structuredContent"]["sim_time"] == 0.8
        assert step["_meta"]["physment/view"]["poses"]["object_1"][2] == pytest.approx(26.86, abs=0.01)
        assert http.post("call", json={"tool": "step", "arguments": {"duration": -1}}).json()["isError"]
        for body in ("no JSON", "[]", '{"tool": "step"}', '{"tool": "step", "arguments": 3}'):
            refused = http.post("call", content=body)
            assert (refused.status_code, list(refused.json())) == (400, ["error"]), body
        unknown = http.post("call", json={"tool": "genie", "arguments": {}})
        assert unknown.status_code in {200, 400}
        assert "genie" in unknown.text
        assert '"time":' in http.get("view").json()["text"]
        # Shown outside a frame, the app still has no access to this origin.
        assert http.get("app").headers["content-security-policy"] == "sandbox allow-scripts"
        assert http.get("state", headers={"host": "example.org"}).status_code == 400
        assert http.post("call", headers={"origin": "http://example.org"}, json={}).status_code == 403
        assert http.get(address.rsplit("/", 2)[0] + "/wrong-token/state").status_code == 404


@pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")
def test_the_app_is_in_a_frame_and_a_call_reaches_it(address: str, tmp_path: Path) -> None:
    assert PROGRAM
    with chromium(PROGRAM, tmp_path / "profile", *SOFTWARE_WEBGL) as page:
        page.send("Network.enable")
        page.look(390, "dark")
        page.visit(address)
        page.wait("!document.getElementById('run').disabled")
        page.run("document.querySelector('[name=duration]').value = '0.1'; document.getElementById('run').click()")
        page.wait("document.getElementById('calls').textContent.includes('let time pass · 0.1 s step{\"sim_time\"')")
        assert page.run("document.querySelector('iframe').getAttribute('sandbox')") == "allow-scripts"
        assert page.run("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
        assert [one for one in page.complaints if "GPU stall" not in one] == []
        assert all(one.startswith(address) for one in page.requests)
