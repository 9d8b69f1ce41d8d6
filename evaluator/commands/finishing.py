"""The last step of commands that play or grade a run: writes grades, summary and report, and prints results."""

import functools
import sys
from collections.abc import Collection, Sequence
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import progress_bar
from evaluator.commands.terminal import print_results
from evaluator.records.episode import Outcome
from evaluator.report.agent_results import Run
from evaluator.report.attachments import Attachments, attached
from evaluator.report.notebook import pictures
from evaluator.report.page import write_report
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.scoring import grade_run
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import is_withheld, seal_note
from scenes.folder import ranges


def finish(
    folder: RunFolder,
    keys: KeyRing,
    console: Console,
    *,
    as_json: bool,
    wanted: int | None = None,
    note: str = "",
    kept: Collection[int] = (),
    keep_laws: bool = False,
) -> int:
    """Grade and score a run once; write its grades, summary and report; print the results.

    Args:
        folder: The run folder.
        keys: Answer keys of the run's scenes.
        console: Console on which the tables are printed.
        as_json: Whether to print the summary to stdout as JSON.
        wanted: Expected number of episodes; None if the run is complete.
        note: Clause about the seal; by default the seal is checked.
        kept: Scenes whose stored grades are kept, because they were played on other packs than those here.
        keep_laws: Whether to keep the grades of unchanged laws that an earlier part of this run has written.

    Returns:
        The exit code: 1 if episodes are missing or could not be played.
    """
    with progress_bar(console) as bar:
        tracked = functools.partial(bar.track, description="grading")
        withhold = is_withheld(folder)
        graded = grade_run(folder, keys, withhold=withhold, kept=kept, keep_laws=keep_laws, tracked=tracked)
    report_on(folder, graded.rows, keys, note or seal_note(folder))
    print_results(console, graded)
    if kept:
        named = f"scene{'' if len(kept) == 1 else 's'} {ranges(sorted(kept))}"
        note = f"played on other packs than those here, so the stored grades are kept: {named}"
        print(f"physment-eval: {note}", file=sys.stderr)
    for line in graded.changes:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
    if as_json:
        print(graded.summary.model_dump_json())
    unplayed = sum(row.episode.outcome is Outcome.INFRASTRUCTURE_ERROR for row in graded.rows)
    missing = 0 if wanted is None else wanted - len(graded.rows)
    if unplayed or missing > 0:
        problems = [f"{unplayed} episodes could not be played"] if unplayed else []
        problems += [f"{missing} episodes are not played yet"] if missing > 0 else []
        print(f"physment-eval: {', '.join(problems)}; try --resume", file=sys.stderr)
        return 1
    return 0


def report_on(folder: RunFolder, rows: Sequence[ScoredEpisode], keys: KeyRing, seal: str) -> Path:
    """Write the report of one run into its folder.

    Args:
        folder: The run folder.
        rows: Scored episodes of the run.
        keys: Answer keys of the run's scenes.
        seal: Clause about the seal of the records.

    Returns:
        Path of the page.

    Raises:
        StoreError: The folder cannot be read or written.
    """
    record = folder.read_run()
    shown = pictures(record.packs, keys.folder)
    found = attached_to(folder, rows, folder)
    return write_report(folder, [Run(folder.path.resolve().name, record, rows, shown, found, seal)])


def attached_to(folder: RunFolder, rows: Sequence[ScoredEpisode], target: RunFolder) -> Attachments:
    """Write the films and frames of a run beside a report, and print which files are left out."""
    found = attached(folder, [row.episode for row in rows], target.path)
    for sentence in found.left_out:
        print(f"physment-eval: {folder.path}: {sentence}", file=sys.stderr)
    return found
