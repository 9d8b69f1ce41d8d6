"""`physment-eval keep-baselines`: converts a run folder to the baseline run that ships with the package."""

import argparse
import lzma
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, folder_to_write
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, Outcome
from evaluator.records.run import RunRecord
from evaluator.report.baselines import EPISODES, FOLDER, RUN, SCORES, packed, write_scores
from evaluator.scores.scoring import grade_record, score_episode
from evaluator.store.run_folder import RunFolder

_DESCRIPTION = """\
Keep a run as the baselines that every report shows: its records, compressed, and their scores. For contributors, after
scenes have changed. CONTRIBUTING.md shows the run.

Scenes that were not played keep their records. An episode that an agent could not begin, such as `batch` in a scene
without one, is left out.
"""


def add(commands: Commands) -> None:
    """Declare the command `keep-baselines` and its options."""
    command = commands.add_parser(
        "keep-baselines", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
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
        anew = set(record.plan.scenes)
        lines = lzma.decompress((args.out / EPISODES).read_bytes()).splitlines()
        kept += [one for one in map(Episode.model_validate_json, lines) if one.key.scene not in anew]
        scenes = tuple(sorted({*former.plan.scenes, *anew}))
        plan = record.plan.model_copy(update={"scenes": scenes})
        record = record.model_copy(update={"plan": plan, "packs": {**former.packs, **record.packs}})
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
    """Raise `UsageError` if a run and the stored baselines differ in agents, budgets, seeds or prompting."""
    for name in ("agents", "budgets", "seeds", "promptings", "protocols"):
        before, now = getattr(former.plan, name), getattr(record.plan, name)
        if before != now:
            raise UsageError(f"the kept baselines have the {name} {before}, this run has {now}; give another --out")
