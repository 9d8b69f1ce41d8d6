"""`physment-eval report` writes stored runs as a page, tables or figures; `keep-baselines` writes its baselines."""

import argparse
import functools
import lzma
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, allow_modified, folder_to_write, progress_bar
from evaluator.commands.finishing import attached_to
from evaluator.errors import StoreError, UsageError
from evaluator.records.episode import Episode, Outcome
from evaluator.records.run import RunRecord
from evaluator.report.agent_results import AgentResults, Run, agent_results, packs_of
from evaluator.report.agent_tables import abilities_table, errata_table, paper_tables
from evaluator.report.baselines import EPISODES, FOLDER, RUN, SCORES, baseline_table, packed, write_scores
from evaluator.report.export import csv_text, latex, markdown
from evaluator.report.notebook import pictures
from evaluator.report.page import paper_page, write_report
from evaluator.report.tables import tables
from evaluator.scores.scoring import grade_record, read_graded, score_episode
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import refuse_other_worlds, seal_note
from scenes import PackError, find_pack, list_packs, same_pack

T = TypeVar("T")

_REPORT = """\
Write report.html of stored runs, several side by side: accuracies with intervals, budgets, categories, dimensions,
failure modes, cost, and a notebook of each episode. The page opens from disk and needs nothing else.

  physment-eval report runs/mine                            runs/mine/report.html
  physment-eval report runs/mine runs/baselines --out out   out/report.html, both side by side
  physment-eval report runs/mine --export latex             the tables too: runs/mine/tables.tex
  physment-eval report runs/mine --figures svg              the figures too: runs/mine/figures/*.svg

Several runs need --out. Films and frames are checked and written beside the page, so that its folder can be moved.
Runs of different packs may share a report: name each folder of packs with --scenes-dir, and every run is scored with
the packs that it was played on.
"""


def add(commands: Commands) -> None:
    """Declare the commands `report` and `keep-baselines` and their options."""
    _add_report(commands)
    _add_keep_baselines(commands)


def _add_report(commands: Commands) -> None:
    command = commands.add_parser(
        "report",
        description=_REPORT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_report)
    command.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="run folders")
    command.add_argument(
        "--out", type=folder_to_write, metavar="DIR", help="where to write (default: the run folder, if one)"
    )
    command.add_argument(
        "--scenes-dir",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder of scene packs that a run was played on (may be repeated; default: the suite)",
    )
    allow_modified(command)
    command.add_argument(
        "--no-baselines", action="store_true", help="leave out the baselines that ship with the package"
    )
    command.add_argument("--export", choices=("md", "csv", "latex"), help="write the tables in this form, too")
    command.add_argument(
        "--paper", action="store_true", help="write the tables in the paper's layout, too: paper.html and paper.tex"
    )
    command.add_argument("--figures", choices=("svg", "pdf"), help="write the figures, too; needs the extra `report`")


def _report(args: argparse.Namespace) -> int:
    if len(args.folders) > 1 and args.out is None:
        raise UsageError("several runs make one report: say where it goes with --out DIR")
    rings = [KeyRing(path) for path in args.scenes_dir] or [KeyRing()]
    if args.scenes_dir:
        rings.append(KeyRing())
    for ring in rings:
        _refuse_missing(ring)
    target = RunFolder(args.out or args.folders[0])
    runs = [
        _read(RunFolder(path), name, rings, trust=args.allow_modified)
        for path, name in zip(args.folders, _names(args.folders), strict=True)
    ]
    try:
        target.path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{target.path} cannot be written: {error.strerror}") from error
    runs = [
        replace(run, attachments=attached_to(RunFolder(path), run.rows, target))
        for path, run in zip(args.folders, runs, strict=True)
    ]
    follow = functools.partial(_followed, "notebooks", sum(len(run.rows) for run in runs))
    written = [write_report(target, runs, baselines=not args.no_baselines, follow=follow)]
    if args.export:
        written += _export(target, agent_results(runs), args.export, baselines=not args.no_baselines)
    if args.paper:
        written += _paper(target, [result for result in agent_results(runs) if result.suite])
    if args.figures:
        from evaluator.report.figures import write_figures  # noqa: PLC0415 - matplotlib is an extra

        written += write_figures(target.path / "figures", agent_results(runs), args.figures)
    for file in written:
        print(file)
    return 0


def _followed(what: str, count: int, items: Iterable[T]) -> Iterable[T]:
    """Yield the items unchanged, and show a progress bar on a terminal."""
    with progress_bar() as bar:
        yield from bar.track(items, count, description=what)


def _names(folders: Sequence[Path]) -> list[str]:
    """The name of each folder, or its path if two folders have the same name."""
    short = [path.resolve().name for path in folders]
    return short if len(set(short)) == len(short) else [str(path) for path in folders]


def _refuse_missing(ring: KeyRing) -> None:
    """Raise if a folder contains neither packs nor worlds."""
    try:
        list_packs(ring.folder)
    except PackError as error:
        raise UsageError(str(error)) from error


def _ring_of(played: Mapping[str, str], rings: Sequence[KeyRing]) -> KeyRing:
    """Choose the answer keys for a run: those of the folder that holds the most of its packs; the first of several."""
    alike = [sum(_is_here(int(scene), stored, ring) for scene, stored in played.items()) for ring in rings]
    return rings[alike.index(max(alike))]


def _is_here(scene: int, stored: str, ring: KeyRing) -> bool:
    try:
        return same_pack(stored, find_pack(scene, ring.folder))
    except PackError:
        return False


def _read(folder: RunFolder, name: str, rings: Sequence[KeyRing], *, trust: bool) -> Run:
    record, seal = folder.read_run(), seal_note(folder, trust=trust)
    keys = _ring_of(record.packs, rings)
    refuse_other_worlds(record, keys.folder)
    evidence = folder.evidence()
    graded = read_graded(folder)
    rows = [
        score_episode(one, grade, keys, evidence.get(one.key))
        for one, grade in _followed(f"scores of {name}", len(graded), graded)
    ]
    return Run(name, record, rows, pictures(record.packs, keys.folder), seal=seal)


def _paper(target: RunFolder, results: Sequence[AgentResults]) -> list[Path]:
    """Write the paper's tables as a page and in LaTeX."""
    found = paper_tables(results)
    texts = {"paper.html": paper_page(target.path.resolve().name, found), "paper.tex": latex(found)}
    for name, text in texts.items():
        target.write_text(target.path / name, text)
    return [target.path / name for name in texts]


def _export(target: RunFolder, results: Sequence[AgentResults], form: str, *, baselines: bool) -> list[Path]:
    """Write the tables: CSV as one file per table, other formats as a single file."""
    found = tables(results)
    floors = baseline_table(packs_of(results)) if baselines else None
    more = (floors, abilities_table(results), errata_table(results))
    found += [table for table in more if table is not None]
    if form == "csv":
        texts = {f"tables-{table.name}.csv": csv_text(table) for table in found}
    else:
        texts = {"tables.md": markdown(found)} if form == "md" else {"tables.tex": latex(found)}
    for name, text in texts.items():
        target.write_text(target.path / name, text)
    return [target.path / name for name in texts]


_KEEP = """\
Keep a run as the baselines that every report shows: its records, compressed, and their scores. For contributors, after
scenes have changed. CONTRIBUTING.md shows the run.

An agent keeps its stored records of scenes that it did not play in this run, unless another agent played them on
another version of the pack. An episode that an agent could not begin, such as `batch` in a scene without one, is left
out.
"""


def _add_keep_baselines(commands: Commands) -> None:
    command = commands.add_parser(
        "keep-baselines", description=_KEEP, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    command.set_defaults(run=_keep)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument(
        "--out", type=folder_to_write, default=FOLDER, metavar="DIR", help="where to (default: in the package)"
    )


def _keep(args: argparse.Namespace) -> int:
    source = RunFolder(args.folder)
    record, played = source.read_run(), list(source.episodes().values())
    if any(episode.outcome is Outcome.INFRASTRUCTURE_ERROR for episode in played):
        raise UsageError(f"{args.folder} has episodes that could not be played; play them with --resume")
    kept = [episode for episode in played if episode.outcome is not Outcome.AGENT_ERROR]
    if (args.out / RUN).is_file():
        former = RunRecord.model_validate_json((args.out / RUN).read_bytes())
        _check_same(former, record)
        lines = lzma.decompress((args.out / EPISODES).read_bytes()).splitlines()
        new, now = {(one.key.scene, one.key.agent) for one in played}, record.content_hashes()
        stored = [one for one in map(Episode.model_validate_json, lines) if (one.key.scene, one.key.agent) not in new]
        changed = {int(scene) for scene, pack in former.content_hashes().items() if now.get(scene, pack) != pack}
        if left := [one for one in stored if one.key.scene in changed]:
            agents = ", ".join(sorted({one.key.agent for one in left}))
            print(f"{len(left)} episodes of {agents} are left out: their packs changed")
        kept += [one for one in stored if one.key.scene not in changed]
        record = _joined(former, record)
    order = {agent: place for place, agent in enumerate(record.plan.agents)}
    # Episodes of one scene are similar, so placing them side by side improves the compression.
    kept.sort(key=lambda one: (one.key.scene, order[one.key.agent], one.key.seed))
    keys = KeyRing()
    args.out.mkdir(parents=True, exist_ok=True)
    lines = "".join(f"{episode.model_dump_json()}\n" for episode in kept)
    (args.out / EPISODES).write_bytes(packed(lines.encode()))
    write_scores(args.out / SCORES, (score_episode(one, grade_record(one, keys), keys) for one in kept))
    (args.out / RUN).write_text(record.model_dump_json(indent=2) + "\n", encoding="utf-8")
    size = sum((args.out / name).stat().st_size for name in (EPISODES, SCORES, RUN))
    print(f"{len(kept)} episodes, {size / 1000:.0f} kB: {args.out}")
    return 0


def _check_same(former: RunRecord, record: RunRecord) -> None:
    """Raise `UsageError` if a run and the stored baselines differ in budgets, seeds or prompting."""
    for name in ("budgets", "seeds", "promptings", "protocols"):
        before, now = getattr(former.plan, name), getattr(record.plan, name)
        if before != now:
            raise UsageError(f"the kept baselines have the {name} {before}, this run has {now}; give another --out")


def _joined(former: RunRecord, record: RunRecord) -> RunRecord:
    """Return the record of a run that contains the scenes and agents of both runs."""
    scenes = tuple(sorted({*former.plan.scenes, *record.plan.scenes}))
    agents = tuple(dict.fromkeys((*former.plan.agents, *record.plan.agents)))
    plan = record.plan.model_copy(update={"scenes": scenes, "agents": agents})
    packs, facts = former.packs | record.packs, former.agents | record.agents
    return record.model_copy(update={"plan": plan, "packs": packs, "agents": facts})
