"""`physment-eval play N`: a person solves a scene in the terminal; saved and graded like any agent's episode."""

import argparse
import contextlib
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

from rich.console import Console
from rich.markdown import Markdown

from evaluator.agents.human import HumanAgent
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, unwrapped, whole
from evaluator.commands.report import report_on
from evaluator.episode.connect import connect
from evaluator.episode.loop import play_episode
from evaluator.records import Episode, EpisodeKey, Grade, Outcome, Plan, Verdict
from evaluator.scores import scoring
from evaluator.store import RunFolder
from evaluator.study.provenance import run_record, server_record
from evaluator.study.selection import parse_scenes
from scenes import PackFiles

_PLAY = """\
Solve a scene yourself, with the tools and the budget of any agent: a human baseline.

  physment-eval play 7
  physment-eval play 21 --seed 3 --budget 10

Type help at the prompt. The episode is saved as a run of the agent `human` and graded. Leaving after the first
iteration is recorded as an episode without an answer; leaving before it leaves nothing behind.
"""


def add(commands: Commands) -> None:
    """Declare `play`."""
    play = commands.add_parser(
        "play",
        help="solve a scene yourself",
        description=_PLAY,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    play.set_defaults(run=_play)
    play.add_argument("scene", type=whole, metavar="N", help="which scene")
    play.add_argument("--seed", type=_seed, default=0, metavar="S", help="variant of the scene (default 0: as written)")
    play.add_argument("--budget", type=whole, default=20, metavar="N", help="iterations (default 20)")
    play.add_argument("--server", default="stdio", metavar="S", help="as in run (default stdio)")
    play.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    play.add_argument("--out", type=Path, metavar="DIR", help="run folder (default runs/TIME-human)")


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text} is not a whole number, 0 or more")
    return int(text)


def _play(args: argparse.Namespace) -> int:
    (files,) = parse_scenes(str(args.scene), args.scenes_dir)
    keys = KeyRing(args.scenes_dir)
    keys.key(args.scene, args.seed)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    folder = RunFolder(args.out or Path("runs") / f"{stamp}-human")
    folder.create(resume=False)
    console, played = Console(), list[Episode]()

    async def play() -> None:
        played.append(await _episode(args, files, folder, console))

    try:
        unwrapped(play)
    except BaseException:
        _remove_if_empty(folder)
        raise
    (episode,) = played
    if episode.outcome is Outcome.AGENT_ERROR and not episode.turns:
        _remove_if_empty(folder)
        console.print("\nNothing was done, and nothing is saved.")
        return 0
    folder.append_episode(episode)
    scoring.grade_run(folder, folder.episodes(), keys)
    grades = folder.grades()
    report_on(folder, keys)
    console.print(_verdict(episode, grades[episode.key].grade), markup=False, highlight=False)
    console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
    return 0


async def _episode(args: argparse.Namespace, files: PackFiles, folder: RunFolder, console: Console) -> Episode:
    """Let the person play; what decides the result is written down once there is one."""
    key = EpisodeKey(scene=args.scene, seed=args.seed, agent="human", budget=args.budget)
    plan = Plan(scenes=(args.scene,), agents=("human",), budgets=(args.budget,), seeds=(args.seed,))
    async with (
        connect(args.server, args.scenes_dir) as laboratory,
        laboratory.open(args.scene, args.seed) as client,
    ):
        record = run_record(plan, [files], await server_record(client, args.server))
        episode = await play_episode(HumanAgent(_Terminal(console)), client, key, record.versions_of(args.scene))
    if episode.turns:
        folder.write_run(record)
    return episode


def _verdict(episode: Episode, grade: Grade) -> str:
    count = len(episode.turns)
    spent = f"{count} of {episode.key.budget} iteration{'s' * (episode.key.budget != 1)}"
    if grade.strict is Verdict.CORRECT:
        return f"\nCorrect, in {spent}."
    forgiven = " (correct in another form)" if grade.normalised is Verdict.CORRECT else ""
    return f"\nNot correct{forgiven}, in {spent}: {grade.reason}"


def _remove_if_empty(folder: RunFolder) -> None:
    with contextlib.suppress(OSError):
        folder.path.rmdir()


def _readline() -> ModuleType | None:
    """Line editing, where the platform has it."""
    try:
        import readline  # noqa: PLC0415 - not everywhere, and only for a terminal
    except ImportError:
        return None
    return readline


@dataclass(slots=True)
class _Terminal:
    """Standard input and output, with completion where there is a terminal."""

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
        """Show plain text."""
        self.console.print(_harmless(text), markup=False, highlight=False, soft_wrap=True)

    def show_page(self, markdown: str) -> None:
        """Show a page, laid out if somebody sees it."""
        text = _harmless(markdown)
        if self.console.is_terminal:
            self.console.print(Markdown(text))
        else:
            self.show(text)

    def ask(self, prompt: str, words: Sequence[str]) -> str:
        """Ask for a line; Ctrl-C while asking raises, which it would not under an event loop."""
        self.words = words
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return input(prompt)
        finally:
            signal.signal(signal.SIGINT, before)

    def complete(self, text: str, state: int) -> str | None:
        """The completion number `state` of a word, as readline asks for it."""
        matching = [one for one in self.words if one.startswith(text)]
        return f"{matching[state]} " if state < len(matching) else None


def _harmless(text: str) -> str:
    """Text of a server for a terminal, which would obey its control characters."""
    return "".join(one if one.isprintable() or one == "\n" else one.encode("unicode_escape").decode() for one in text)
