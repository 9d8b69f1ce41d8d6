"""`physment-eval fork`: lets another agent continue stored episodes from a given turn."""

import argparse
from pathlib import Path

from evaluator.agents.presentation import parse_presentation
from evaluator.answers.keys import KeyRing
from evaluator.commands.agent_options import USUAL_CONCURRENCY, add_model_options, model_options
from evaluator.commands.base import (
    Commands,
    allow_modified,
    count_of,
    folder_to_write,
    results_console,
    seconds,
    seed_key,
)
from evaluator.commands.playing import PreparedRun, create_folder, play_run
from evaluator.episode.loop import AgentParticipant
from evaluator.errors import UsageError
from evaluator.records.episode import Episode
from evaluator.records.run import ForkedRun, Plan, SeedKey
from evaluator.store.run_folder import RunFolder
from evaluator.study.forking import CONDITIONS, ForkParticipant, fork_keys, select_episodes
from evaluator.study.integrity import (
    pass_on_key,
    read_revealed,
    read_seed_key,
    refuse_other_worlds,
    seal_note,
    seeds_of,
)
from evaluator.study.meter import Meter
from evaluator.study.run_config import RunConfig, participants_of
from scenes import PackError, find_pack

_DESCRIPTION = f"""\
Play stored episodes again, bit for bit, up to a turn, and let another agent go on from there. It is told what was done
so far and what it returned, not what the first agent thought. Two agents forked from the same turn have the same
evidence, so that the difference is what they make of it.

  physment-eval fork runs/mine --episode scene=7,seed=3 --turn 2 --agent model:gpt-5.5
  physment-eval fork runs/mine --episode agent=blind --turn 1 --agent reference --agent random --out runs/forks

--episode takes conditions, separated by commas: {", ".join(CONDITIONS)}. Every stored episode that meets them and goes
on after the turn is continued. The result is a run folder like any other; each record names the episode and the turn
that it continues. If the laboratory returns anything else than what is stored, the fork is refused and says where.
"""


def add(commands: Commands) -> None:
    """Declare the command `fork` and its options."""
    fork = commands.add_parser(
        "fork",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    fork.set_defaults(run=_fork)
    fork.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    fork.add_argument("--episode", required=True, metavar="NAME=VALUE,…", help="which episodes, such as scene=7,seed=3")
    fork.add_argument(
        "--turn", required=True, type=count_of("turns"), metavar="K", help="how many turns are played as stored"
    )
    fork.add_argument(
        "--agent", action="append", required=True, metavar="A", help="who goes on, as for run; may be repeated"
    )
    fork.add_argument(
        "--server", default="host", metavar="S", help="stdio · host (default) · the URL of a host · a command"
    )
    fork.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs of the run")
    seed_key(fork)
    allow_modified(fork)
    fork.add_argument("--out", type=folder_to_write, metavar="DIR", help="the new run folder (default runs/TIME-AGENT)")
    fork.add_argument("--resume", action="store_true", help="continue the fork in --out")
    fork.add_argument(
        "--concurrency",
        type=count_of("episodes"),
        default=USUAL_CONCURRENCY,
        metavar="N",
        help="episodes played at a time (default %(default)s)",
    )
    fork.add_argument(
        "--episode-timeout", type=seconds, default=7200.0, metavar="S", help="wall time of one attempt [s] (7200)"
    )
    fork.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")
    add_model_options(fork.add_argument_group("models"))


def _fork(args: argparse.Namespace) -> int:
    source = RunFolder(args.folder)
    record = source.read_run()
    refuse_other_worlds(record, args.scenes_dir)
    seal_note(source, trust=args.allow_modified)
    episodes = select_episodes(source, args.episode, args.turn)
    seed_of = seeds_of(source, args.seed_key)
    key = read_seed_key(args.seed_key) if args.seed_key else read_revealed(source)
    config = _config(args, episodes, record.plan, key if record.plan.held_back else None)
    built, agents = participants_of(config), dict[str, AgentParticipant]()
    for name, participant in built.items():
        if not isinstance(participant, AgentParticipant):
            raise UsageError(f"--agent {name}: a program plays by itself from the start, and cannot go on from a fork")
        agents[name] = participant
    keys = fork_keys(episodes, list(agents))
    hashes = source.line_hashes()
    participants = {name: ForkParticipant(inner, keys, hashes, args.turn) for name, inner in agents.items()}
    seal = source.read_seal()
    run = PreparedRun(
        config=config,
        participants=participants,
        plan=config.plan(participants).model_copy(update={"held_back": record.plan.held_back}),
        keys=list(keys),
        folder=create_folder(config, participants),
        answers=KeyRing(args.scenes_dir, seed_of),
        meter=Meter(config.limits),
        console=results_console(as_json=args.json),
        forked_from=ForkedRun(folder=args.folder.resolve().name, seal_head=seal.head if seal else "", turn=args.turn),
    )
    pass_on_key(source, run.folder)
    return play_run(run)


def _config(args: argparse.Namespace, episodes: list[Episode], stored: Plan, seed_key: SeedKey | None) -> RunConfig:
    """The configuration of a run with the same scenes, seeds and budgets as these episodes."""
    keys = [episode.key for episode in episodes]
    try:
        packs = tuple(find_pack(scene, args.scenes_dir) for scene in sorted({key.scene for key in keys}))
    except PackError as error:
        raise UsageError(str(error)) from error
    return RunConfig(
        agents=tuple(args.agent),
        scenes_dir=args.scenes_dir,
        server=args.server,
        observations=stored.observations,
        presentation=parse_presentation(",".join(stored.presentation)),
        seed_key=seed_key,
        packs=packs,
        budgets=tuple(sorted({key.budget for key in keys})),
        seeds=tuple(sorted({key.seed for key in keys})),
        epochs=max(key.epoch for key in keys),
        same_seeds=True,
        promptings=tuple(dict.fromkeys(key.prompting for key in keys)),
        protocols=tuple(dict.fromkeys(key.protocol for key in keys)),
        concurrency=args.concurrency,
        workers=1,
        episode_timeout_s=args.episode_timeout,
        out=args.out,
        resume=args.resume,
        as_json=args.json,
        **model_options(args),
    )
