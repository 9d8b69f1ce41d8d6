"""`physment-eval play N`: a person solves a scene in the terminal. The episode is saved and graded as any other."""

import argparse
import contextlib
import functools
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
from evaluator.commands.argument_types import count_of, scene_id, seed
from evaluator.commands.base import Commands, run_async
from evaluator.commands.report import report_on
from evaluator.commands.terminal import printable
from evaluator.episode.connect import connect
from evaluator.episode.loop import play_episode
from evaluator.records import Episode, EpisodeKey, Outcome, Verdict
from evaluator.run_record import Plan
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.scoring import grade_run
from evaluator.store import RunFolder
from evaluator.study.provenance import run_record, server_record
from evaluator.study.sealing import seal_note
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
        description=_PLAY,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    play.set_defaults(run=_play)
    play.add_argument("scene", type=scene_id, metavar="N", help="which scene")
    play.add_argument("--seed", type=seed, default=0, metavar="S", help="variant of the scene (default 0: as written)")
    play.add_argument("--budget", type=count_of("iterations"), default=20, metavar="N", help="iterations (default 20)")
    play.add_argument("--server", default="stdio", metavar="S", help="as in run (default stdio)")
    play.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    play.add_argument("--out", type=Path, metavar="DIR", help="run folder (default runs/TIME-human)")


def _play(args: argparse.Namespace) -> int:
    (files,) = parse_scenes(str(args.scene), args.scenes_dir)
    keys = KeyRing(args.scenes_dir)
    keys.key(args.scene, args.seed)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    folder = RunFolder(args.out or Path("runs") / f"{stamp}-human")
    folder.create(resume=False)
    console = Console()
    try:
        episode = run_async(functools.partial(_episode, args, files, folder, console))
    except BaseException:
        _remove_if_empty(folder)
        raise
    if episode.outcome is Outcome.AGENT_ERROR and not episode.turns:
        _remove_if_empty(folder)
        console.print("\nNothing was done, and nothing is saved.")
        return 0
    folder.append_episode(episode)
    graded = grade_run(folder, keys)
    report_on(folder, graded.rows, keys, seal_note(folder))
    (row,) = graded.rows
    console.print(_verdict(row), markup=False, highlight=False)
    console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
    return 0


async def _episode(args: argparse.Namespace, files: PackFiles, folder: RunFolder, console: Console) -> Episode:
    """Let the person play. `run.json` is written only if the person took a turn."""
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


def _verdict(row: ScoredEpisode) -> str:
    spent = f"{len(row.episode.turns)} of {row.key.budget} iteration{'s' * (row.key.budget != 1)}"
    if row.is_correct:
        return f"\nCorrect, in {spent}."
    forgiven = " (correct in another form)" if row.grade.normalised is Verdict.CORRECT else ""
    return f"\nNot correct{forgiven}, in {spent}: {row.grade.reason}"


def _remove_if_empty(folder: RunFolder) -> None:
    with contextlib.suppress(OSError):
        folder.path.rmdir()


def _readline() -> ModuleType | None:
    """The module for line editing; None if the platform has none."""
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
        """Show plain text."""
        self.console.print(printable(text, keep="\n"), markup=False, highlight=False, soft_wrap=True)

    def show_page(self, markdown: str) -> None:
        """Show a page of Markdown, laid out on a terminal."""
        text = printable(markdown, keep="\n")
        if self.console.is_terminal:
            self.console.print(Markdown(text))
        else:
            self.show(text)

    def ask(self, prompt: str, words: Sequence[str]) -> str:
        """Ask for a line. Ctrl-C raises KeyboardInterrupt meanwhile, which the event loop would prevent."""
        self.words = words
        previous = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return input(prompt)
        finally:
            signal.signal(signal.SIGINT, previous)

    def complete(self, text: str, state: int) -> str | None:
        """Completion number `state` of a word, as readline asks for it."""
        matching = [word for word in self.words if word.startswith(text)]
        return f"{matching[state]} " if state < len(matching) else None
