"""Tests of the chat app in headless Chromium, in a page that embeds it by the official bridge.

The app shows the scene, plays a step, and makes no requests.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from PIL import Image

from physment_mcp.contract.names import VIEW_URI
from physment_mcp.scene import load_scene
from physment_mcp.serving.resources import APP_URI
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.session import Session
from physment_mcp.visibility import cached_visibility
from tests.builders.app_client import app_client
from tests.builders.chromium import SOFTWARE_WEBGL, Page, chromium, installed
from tests.builders.viewer import bundled, needs_node, page_with

PROGRAM = installed()
pytestmark = [needs_node, pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")]


@pytest.fixture(scope="module")
def host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return page_with(bundled("test/host.ts"), tmp_path_factory.mktemp("host"))


@pytest.fixture(params=[SOFTWARE_WEBGL, ("--disable-3d-apis",)], ids=["webgl", "outline"])
def browser(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Page]:
    assert PROGRAM
    with chromium(PROGRAM, tmp_path / "profile", *request.param) as page:
        page.flat = request.param != SOFTWARE_WEBGL  # type: ignore[attr-defined]
        page.send("Network.enable")
        page.look(700, "light", 620)
        yield page


async def _results() -> tuple[str, dict[str, Any], dict[str, Any], str]:
    """Return the app, the result of a step, a refusal, and the view after them, as a client receives them."""
    slot = EpisodeSlot(Session(load_scene(7)), find_visibility=cached_visibility(None))
    async with app_client(build_server(slot)) as client:
        page = (await client.read_resource(APP_URI)).contents[0]
        step, refused = [await client.call_tool("step", {"duration": duration}) for duration in (0.4, -1)]
        view = (await client.read_resource(VIEW_URI)).contents[0]
        dumped = [one.model_dump(mode="json", by_alias=True, exclude_none=True) for one in (step, refused)]
        return page.text, dumped[0], dumped[1], view.text  # type: ignore[union-attr]


def pixels(browser: Page, file: Path) -> np.ndarray:
    """Return the image of the scene itself, above the controls."""
    browser.picture(file, whole=False)
    return np.asarray(Image.open(file).convert("RGB"), dtype=np.int16)[20:380]


def test_the_app_shows_the_scene_plays_the_step_and_asks_nobody(host: Path, browser: Page, tmp_path: Path) -> None:
    app, step, refused, view = anyio.run(_results)
    shot = tmp_path / "shot.png"
    browser.open(host)
    empty = pixels(browser, shot)
    browser.run(f"host.open({json.dumps(app)}, 'light', {json.dumps(view)})")
    # The ball is red. It is seen as soon as the app opens, and nothing red was there before.
    assert red(empty) == 0
    seen(browser, shot, lambda picture: red(picture) > 200)
    assert browser.run("host.said") == [{"read": VIEW_URI}]
    browser.run(f"host.give({json.dumps(step)})")
    browser.wait("host.said.length > 1")
    _, told = browser.run("host.said")
    assert (told["drawn"], told["flat"]) == (1, browser.flat)  # type: ignore[attr-defined]
    light = seen(browser, shot, lambda picture: red(picture) > 200)
    assert any(plays(browser, step, shot) for _ in range(5))
    # After a refusal the app reads the current view and shows the error message.
    browser.run(f"host.give({json.dumps(refused)})")
    browser.wait("host.said.filter((one) => one.read === 'physment://view').length === 2")
    browser.run("host.dress('dark')")
    assert light.mean() > 200
    seen(browser, shot, lambda picture: picture.mean() < 100 and red(picture) > 200)
    assert [one for one in browser.complaints if "GPU stall" not in one] == []
    assert {address.split("?")[0] for address in browser.requests} == {host.resolve().as_uri()}


def seen(browser: Page, shot: Path, holds: Callable[[np.ndarray], bool]) -> np.ndarray:
    """Take screenshots until one meets a condition, because the browser paints some time after the page draws."""
    for _ in range(100):
        if holds(picture := pixels(browser, shot)):
            return picture
    raise AssertionError(f"never seen; {shot} shows the last picture")


def plays(browser: Page, step: dict[str, Any], shot: Path) -> bool:
    """Whether screenshots differ while a step is played; a slow machine may take them too late."""
    browser.run(f"host.give({json.dumps(step)})")
    first, *others = [pixels(browser, shot) for _ in range(4)]
    return any(np.abs(one - first).max() > 60 for one in others)


def red(picture: np.ndarray) -> int:
    """Count the pixels that are clearly red."""
    return int(((picture[..., 0] - picture[..., 1] > 60) & (picture[..., 0] - picture[..., 2] > 60)).sum())
