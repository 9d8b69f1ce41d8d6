"""`physment-eval evidence`: measures how far the readings of stored episodes determine the answer."""

import argparse
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from evaluator.agents.reference import calls_and_readings
from evaluator.certify.evidence import measured
from evaluator.certify.processes import in_processes
from evaluator.certify.subject import Subject
from evaluator.commands.base import Commands, count_of, progress_bar, run_async, seed_key, wide_console
from evaluator.commands.terminal import evidence_table, printable
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, Outcome, Verdict
from evaluator.records.evidence import CERTAIN, SUFFICIENT, EvidenceRecord, EvidenceVerdict
from evaluator.scores.scored_episode import MeasuredEpisode, evidence_summary
from evaluator.store.run_folder import RunFolder
from evaluator.study.forking import CONDITIONS, meeting
from evaluator.study.integrity import is_keyed_world, is_withheld, refuse_other_worlds, seeds_of
from scenes import PackError, find_pack

_DESCRIPTION = f"""\
Measure what the experiments of stored episodes could tell, whoever reasons about them. The calls of an episode are
played again with slightly different hidden values; how far its readings change bounds how well any inference could
know the answer (Cramér and Rao). The evidence suffices if the smallest standard error of each asked number is at most
{SUFFICIENT:g} of its tolerance, a choice is right with a probability of {CERTAIN:.0%}, and the readings exclude
structures that answer otherwise. With the grade, each episode is one of four:

  {EvidenceVerdict.EARNED:<48} right, on sufficient evidence
  {EvidenceVerdict.GUESSED:<48} right, although the readings leave the answer open
  {EvidenceVerdict.INFERENCE_FAILED:<48} wrong, although the readings decide it
  {EvidenceVerdict.EXPERIMENT_INSUFFICIENT:<48} wrong, and the readings leave it open

  physment-eval evidence runs/mine                             every episode that was not measured yet
  physment-eval evidence runs/mine --episodes scene=28,seed=3  some of them

--episodes takes conditions, separated by commas: {", ".join(CONDITIONS)}. Each episode becomes a line of
DIR/evidence.jsonl as soon as it is measured, so an interrupted command goes on where it was. It runs the solution.py of
each scene: name only folders of scenes that you trust.
"""


def add(commands: Commands) -> None:
    """Declare the command `evidence` and its options."""
    command = commands.add_parser(
        "evidence", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    command.set_defaults(run=_evidence)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument("--episodes", default="", metavar="NAME=VALUE,…", help="which episodes (default: all)")
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    seed_key(command)
    command.add_argument(
        "--workers",
        type=count_of("processes"),
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (default: one per core)",
    )
    command.add_argument("--json", action="store_true", help="print the evidence as JSON lines instead of a table")


def _evidence(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    if not folder.episodes_file.exists():
        raise UsageError(f"{args.folder} holds no episodes to measure")
    episodes = [one for one in folder.episodes().values() if one.outcome is not Outcome.INFRASTRUCTURE_ERROR]
    if folder.run_file.exists():
        refuse_other_worlds(folder.read_run(), args.scenes_dir)
    if args.episodes:
        episodes = meeting(episodes, args.episodes, "--episodes", folder)
    hashes, seed_of = folder.line_hashes(), seeds_of(folder, args.seed_key)
    there = folder.evidence()
    wanted = [episode for episode in episodes if episode.key not in there]
    withheld = folder.run_file.exists() and is_withheld(folder)

    def work(same: Sequence[Episode]) -> Callable[[], EvidenceRecord]:
        first = same[0]
        seed = seed_of(first.key.scene, first.key.seed)
        return partial(_measured, first, seed, hashes[first.key], args.scenes_dir)

    console = wide_console()
    with folder.held(), progress_bar() as progress:
        task = progress.add_task("evidence", total=len(wanted))

        def on_done(same: Sequence[Episode], measured: EvidenceRecord) -> None:
            keyed = is_keyed_world(same[0].key.scene, args.scenes_dir)
            found = _without_names(measured) if withheld or keyed else measured
            for number, episode in enumerate(same):
                own = {"key": episode.key, "episode": hashes[episode.key], "seconds": 0.0 if number else found.seconds}
                there[episode.key] = found.model_copy(update=own)
                folder.append_evidence(there[episode.key])
                progress.advance(task)

        run_async(partial(in_processes, _same_experiments(wanted), work, args.workers, on_done))
    if args.json:
        for episode in episodes:
            print(there[episode.key].model_dump_json())
    else:
        verdicts = {key: grade.grade.strict for key, grade in folder.grades().items()}
        strict = [verdicts.get(episode.key, Verdict.UNSCORED) for episode in episodes]
        _print(
            console,
            [MeasuredEpisode(one, there[one.key], verdict) for one, verdict in zip(episodes, strict, strict=True)],
        )
    return 0


def _same_experiments(episodes: Iterable[Episode]) -> list[list[Episode]]:
    """Group the episodes that differ only in their answers: their evidence is the same, so it is measured once."""
    found: dict[str, list[Episode]] = {}
    for episode in episodes:
        turns = [turn for turn, _ in episode.accepted_calls()]
        calls = [(call.tool, call.arguments, reading) for call, reading in calls_and_readings(episode)]
        experiments = json.dumps([episode.key.scene, episode.key.seed, turns, calls])
        found.setdefault(experiments, []).append(episode)
    return list(found.values())


def _measured(episode: Episode, seed: int, line_sha256: str, scenes_dir: Path | None) -> EvidenceRecord:
    """The evidence of one episode; runs in a worker process."""
    try:
        subject = Subject.open(find_pack(episode.key.scene, scenes_dir))
    except PackError as error:
        return EvidenceRecord(key=episode.key, episode=line_sha256, not_measurable=str(error))
    return measured(subject, seed, episode, line_sha256)


def _without_names(found: EvidenceRecord) -> EvidenceRecord:
    """Replace the names of rivals by numbers: a name would reveal a value that the held-back seed does not have."""
    unnamed = [rival.model_copy(update={"name": f"rival {n}"}) for n, rival in enumerate(found.rivals, start=1)]
    return found.model_copy(update={"rivals": tuple(unnamed)})


def _print(console: Console, measured: Sequence[MeasuredEpisode]) -> None:
    """Print a table with a row for each agent: its verdicts, and the number of calls until the evidence sufficed."""
    agents = sorted({one.episode.key.agent for one in measured})
    found = {name: evidence_summary(one for one in measured if one.episode.key.agent == name) for name in agents}
    console.print(evidence_table({name: summary for name, summary in found.items() if summary is not None}))
    reasons = Counter(one.evidence.not_measurable for one in measured if one.evidence.not_measurable)
    for reason, count in reasons.most_common():
        console.print(f"{count} not measurable: {printable(reason)}", markup=False, highlight=False)
