"""Drives a page in headless Chromium through the DevTools protocol, as a user would: read, click, type."""

import base64
import contextlib
import itertools
import json
import shutil
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

FLAGS = (
    "--headless",
    "--no-sandbox",  # CI runs as root, and as root Chromium starts only with this flag
    "--disable-gpu",
    "--disable-quic",
    "--disable-dev-shm-usage",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--remote-debugging-port=0",
)
SOFTWARE_WEBGL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""Flags with which WebGL draws without a graphics card."""
_NEVER_S = 120
"""Wall time after which a condition counts as never true [s]."""
KEYS = {"Tab": 9, "Enter": 13, "End": 35, "Home": 36, "ArrowUp": 38, "ArrowDown": 40}


class Navigated(Exception):
    """The page was replaced by another one while it evaluated an expression."""


class Page:
    """One tab."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._ids = itertools.count(1)
        self._loaded = False
        self.complaints: list[str] = []
        """Console errors, exceptions and violations of the content security policy."""
        self.requests: list[str] = []
        """URLs that the page requested, without data URLs; recorded if the DevTools domain Network is enabled."""

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._ids)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            message = json.loads(self._socket.recv(timeout=300))
            if message.get("id") == number:
                if "navigated" in message.get("error", {}).get("message", ""):
                    raise Navigated(method)
                assert "error" not in message, message
                return message["result"]
            self._note(message)

    def _note(self, message: dict[str, Any]) -> None:
        said = message.get("params", {})
        if message.get("method") == "Network.requestWillBeSent" and not said["request"]["url"].startswith("data:"):
            self.requests.append(said["request"]["url"])
        self._loaded |= message.get("method") == "Page.loadEventFired"
        if message.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(json.dumps(said["exceptionDetails"]))
        if message.get("method") == "Runtime.consoleAPICalled" and said["type"] in {"error", "warning", "assert"}:
            self.complaints.append(json.dumps(said["args"]))
        if message.get("method") == "Log.entryAdded" and said["entry"]["level"] in {"error", "warning"}:
            self.complaints.append(said["entry"]["text"])

    def open(self, file: Path, anchor: str = "") -> None:
        """Open a file from disk and wait until it is loaded."""
        self.visit(file.resolve().as_uri() + anchor)

    def visit(self, address: str) -> None:
        """Open a URL and wait until it is loaded."""
        for url in ("about:blank", address):
            self._loaded = False
            self.send("Page.navigate", url=url)
            while not self._loaded:
                self._note(json.loads(self._socket.recv(timeout=300)))

    def run(self, script: str) -> Any:
        """Evaluate a JavaScript expression in the page and return its value."""
        found = self.send("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, condition: str) -> None:
        """Wait until a JavaScript expression is true, also in a page that loads in the meantime.

        The wait fails only after `_NEVER_S` seconds, because a busy machine may be slow.
        """
        ends = time.monotonic() + _NEVER_S
        while time.monotonic() < ends:
            with contextlib.suppress(Navigated):
                if self.run(condition):
                    return
                self.run("new Promise((done) => setTimeout(done, 50))")
        raise AssertionError(f"never came true: {condition}")

    def press(self, key: str) -> None:
        """Press a key as a person would."""
        text = {"text": "\r"} if key == "Enter" else {}
        code = KEYS[key]
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code, **text)

    def look(self, width: int, scheme: str, height: int = 900, scale: float = 1) -> None:
        """Set the size of the window [px], the preferred colour scheme, and the device pixel ratio."""
        self.send(
            "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=False
        )
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])

    def picture(self, file: Path, *, whole: bool = True) -> None:
        """Write a screenshot to a file."""
        found = self.send("Page.captureScreenshot", captureBeyondViewport=whole)
        file.write_bytes(base64.b64decode(found["data"]))


def installed() -> str | None:
    """Path of the installed Chromium; None if there is none."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


@contextmanager
def chromium(program: str, profile: Path, *flags: str) -> Generator[Page]:
    """Start a browser and yield a tab; the browser ends with the block."""
    with separate_tabs(program, profile, 1, *flags) as (page,):
        yield page


@contextmanager
def separate_tabs(program: str, profile: Path, number: int, *flags: str) -> Generator[list[Page]]:
    """Start a browser and yield tabs that share no storage, as if each had a browser of its own."""
    command = [program, *FLAGS, *flags, f"--user-data-dir={profile}", "about:blank"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            told = next(line for line in process.stderr if line.startswith("DevTools listening on "))
            with connect(told.split()[-1], max_size=None, proxy=None) as socket, contextlib.ExitStack() as sockets:
                browser = Page(socket)
                root = told.split()[-1].split("/devtools/")[0]
                pages: list[Page] = []
                for _ in range(number):
                    context = browser.send("Target.createBrowserContext")["browserContextId"]
                    tab = browser.send("Target.createTarget", url="about:blank", browserContextId=context)["targetId"]
                    address = f"{root}/devtools/page/{tab}"
                    pages.append(Page(sockets.enter_context(connect(address, max_size=None, proxy=None))))
                for page in pages:
                    for domain in ("Page", "Runtime", "Log"):
                        page.send(f"{domain}.enable")
                yield pages
                browser.send("Browser.close")
            process.wait(timeout=300)
        finally:
            process.kill()
