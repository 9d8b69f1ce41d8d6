"""`physment-eval play N --web`: serves the page of a person, who may play further variants after the first one."""

import contextlib
import socket
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import anyio.to_thread

from evaluator.agents.browser.app import ABSENT_S, app, hash_of
from evaluator.agents.browser.cards import Ending
from evaluator.agents.browser.player import PageState
from evaluator.commands.base import listening, open_page, page_token, run_async
from evaluator.commands.human_episode import HumanPlay, PreparedEpisode, kept_if_used
from evaluator.commands.page_server import serving
from scenes import PackError, PackFiles, is_world, list_packs
from scenes.public import read_public


def play_in_browser(play: HumanPlay, first: PreparedEpisode, port: int, *, opens: bool) -> None:
    """Let the person play in the browser, until the page is closed or Ctrl-C.

    Args:
        play: Settings of the command.
        first: The first variant.
        port: Port of the page; 0 for any free one.
        opens: Whether to open the page in a browser.

    Raises:
        UsageError: The port is taken, or the server cannot be reached.
    """
    token = page_token()
    with listening("127.0.0.1", port) as listener:
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/{token}/"
        print(f"play at {address} (Ctrl-C leaves)", flush=True)
        if opens:
            open_page(address)
        run_async(lambda: _serve(listener, token, play, first))


async def _serve(listener: socket.socket, token: str, play: HumanPlay, first: PreparedEpisode) -> None:
    page = PageState()
    async with serving(app({hash_of(token): page}), listener, page.close):
        await _play_all(page, play, first)


async def _play_all(page: PageState, play: HumanPlay, first: PreparedEpisode) -> None:
    """Play the first variant, and then those that the person chooses on the page."""
    names = _folders(first.folder.path)
    variant = first
    while True:
        with kept_if_used(variant.folder):
            episode = await play.play(variant, page)
        ending = await anyio.to_thread.run_sync(play.finish, variant, episode)
        following = _following(variant.files, play.scenes_dir)
        page.end(_with_choices(ending, variant, following))
        choice = await page.choice(ABSENT_S)
        if choice is None:
            return
        files, seed = (following or variant.files, 0) if choice == "scene" else (variant.files, variant.seed + 1)
        variant = play.variant(files, seed, next(names))
        page.begin()


def _with_choices(ending: Ending, variant: PreparedEpisode, following: PackFiles | None) -> Ending:
    choices = {"seed": f"seed {variant.seed + 1}"}
    if following is not None:
        choices["scene"] = f"scene {following.scene_id}, {read_public(following).name}"
    return replace(ending, choices=choices)


def _following(files: PackFiles, scenes_dir: Path | None) -> PackFiles | None:
    """Return the pack with the next id; None after the last one, and for a world."""
    if is_world(files.scene_id):
        return None
    with contextlib.suppress(PackError):
        return next((found for found in list_packs(scenes_dir) if found.scene_id > files.scene_id), None)
    return None


def _folders(first: Path) -> Iterator[Path]:
    """Yield unused names of further run folders next to the first one: `NAME-2`, `NAME-3` and so on."""
    number = 2
    while True:
        path = first.with_name(f"{first.name}-{number}")
        if not path.exists():
            yield path
        number += 1
