"""`physment-eval play N`: a person solves a scene in the terminal or the browser.

The episode is saved and graded as any other.
"""

import argparse
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

from rich.console import Console
from rich.markdown import Markdown

from evaluator.agents.human import HumanAgent
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, count_of, folder_to_write, port, run_async, scene_id, seed, usual_folder
from evaluator.commands.human_episode import HumanPlay, kept_if_used, play_in_browser
from evaluator.commands.terminal import printable
from evaluator.study.selection import parse_scenes
from scenes import reference_of

_PLAY = """\
Solve a scene yourself, with the tools and the budget of any agent: a human baseline.

  physment-eval play 7
  physment-eval play 21 --seed 3 --budget 10
  physment-eval play 7 --web                  in the browser: the scene in three dimensions, tools as forms

Type help at the prompt. The episode is saved as a run of the agent `human` and graded. Leaving after the first
iteration is recorded as an episode without an answer; leaving before it leaves nothing behind.
"""


def add(commands: Commands) -> None:
    """Declare the command `play` and its options."""
    play = commands.add_parser(
        "play",
        description=_PLAY,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    play.set_defaults(run=_play)
    play.add_argument("scene", type=scene_id, metavar="N", help="which scene")
    play.add_argument("--seed", type=seed, default=0, metavar="S", help="variant of the scene (default 0: as written)")
    play.add_argument("--budget", type=count_of("iterations"), default=20, metavar="N", help="iterations (default 20)")
    play.add_argument("--server", default="stdio", metavar="S", help="as in run (default stdio)")
    play.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    play.add_argument("--out", type=folder_to_write, metavar="DIR", help="run folder (default runs/TIME-human)")
    play.add_argument(
        "--web", action="store_true", help="play in the browser, on a page for this machine and one person alone"
    )
    play.add_argument("--port", type=port, default=0, help="port of the page (default: any free one)")
    play.add_argument("--no-open", action="store_true", help="print the address of the page, and open no browser")


def _play(args: argparse.Namespace) -> int:
    (files,) = parse_scenes(reference_of(args.scene), args.scenes_dir)
    console = Console()
    play = HumanPlay(args.server, args.scenes_dir, args.budget, KeyRing(args.scenes_dir), console)
    variant = play.variant(files, args.seed, args.out or usual_folder("human"))
    with kept_if_used(variant.folder):
        if args.web:
            play_in_browser(play, variant, args.port, opens=not args.no_open)
        else:
            agent = HumanAgent(_Terminal(console))
            play.finish(variant, run_async(lambda: play.play(variant, agent)))
    return 0


def _readline() -> ModuleType | None:
    """The `readline` module; None if the platform has none."""
    try:
        import readline  # noqa: PLC0415 - some platforms have none, and only a terminal needs it
    except ImportError:
        return None
    return readline


@dataclass(slots=True)
class _Terminal:
    """Standard input and output, with completion on a terminal."""

    console: Console
    words: Sequence[str] = ()
    editing: ModuleType | None = field(init=False)

    def __post_init__(self) -> None:
        self.editing = _readline() if sys.stdin.isatty() else None
        if self.editing is not None:
            self.editing.set_completer(self.complete)
            self.editing.set_completer_delims(" \t;=,[")
            self.editing.parse_and_bind("tab: complete")

    def show(self, text: str) -> None:
        """Print plain text."""
        self.console.print(printable(text, keep="\n"), markup=False, highlight=False, soft_wrap=True)

    def show_page(self, markdown: str) -> None:
        """Print Markdown, rendered if the output is a terminal."""
        text = printable(markdown, keep="\n")
        if self.console.is_terminal:
            self.console.print(Markdown(text))
        else:
            self.show(text)

    def ask(self, prompt: str, words: Sequence[str]) -> str:
        """Read a line. Meanwhile Ctrl-C raises KeyboardInterrupt, which the handler of the event loop would prevent."""
        self.words = words
        previous = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return input(prompt)
        finally:
            signal.signal(signal.SIGINT, previous)

    def complete(self, text: str, state: int) -> str | None:
        """Completer for readline: the completion number `state` of a word."""
        matching = [word for word in self.words if word.startswith(text)]
        return f"{matching[state]} " if state < len(matching) else None
