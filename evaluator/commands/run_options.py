"""The command line options of `run`, and their conversion to a `RunConfig`."""

import argparse
import math
import os
from collections.abc import Mapping
from pathlib import Path

from evaluator.agents.presentation import Change, parse_presentation
from evaluator.agents.stopping import POLICIES
from evaluator.commands.adaptive import add_adaptive_options
from evaluator.commands.agent_options import (
    USUAL_CONCURRENCY,
    add_external_options,
    add_model_options,
    check_sealed,
    model_options,
    usual_concurrency,
)
from evaluator.commands.base import (
    PROMPTINGS,
    PROTOCOLS,
    OptionGroup,
    allow_modified,
    count_of,
    folder_to_write,
    seconds,
    unproved,
    us_dollars,
)
from evaluator.errors import UsageError
from evaluator.records.run import SEED_SHIFT
from evaluator.study import process_executor
from evaluator.study.integrity import read_seed_key
from evaluator.study.meter import Limits
from evaluator.study.run_config import AGENTS, EXTERNAL, RunConfig
from evaluator.study.selection import (
    SUITE,
    USUAL_SEEDS,
    Selected,
    find_split,
    parse_numbers,
    parse_scenes,
    select,
)
from evaluator.study.shards import parse_shard, shard_of_environment
from scenes import is_world
from scenes.splits import HELD_BACK, splits

MOST_EPISODES = 1_000_000
"""Largest matrix of a run. Its keys are made before the first episode."""


def read_options(args: argparse.Namespace, environ: Mapping[str, str] = os.environ) -> RunConfig:
    """Convert parsed options to a `RunConfig`.

    Args:
        args: Result of a parser with the options of `add_options`.
        environ: Environment variables, from which the shard of a scheduler is read.

    Raises:
        UsageError: An option is malformed or selects nothing.
    """
    check_sealed(args)
    split, packs, seeds = _selected(args)
    config = RunConfig(
        agents=tuple(args.agent or ["reference"]),
        scenes_dir=args.scenes_dir,
        server=args.server,
        observations=args.observations,
        **model_options(args),
        stopping=args.stopping,
        presentation=parse_presentation(args.presentation),
        command=tuple(args.command_words),
        max_calls=args.max_calls,
        max_wall_s=args.max_wall_time,
        home=args.home_template,
        sealed=args.sealed,
        users=tuple(filter(None, args.sealed_users.split(","))),
        seed_key=read_seed_key(args.seed_key) if args.seed_key else None,
        packs=packs,
        split=split,
        budgets=parse_numbers(args.budgets, "--budgets", 1),
        seeds=seeds,
        spare_seeds=_spare_seeds(args),
        unproved=args.unproved,
        epochs=args.epochs,
        same_seeds=args.same_seeds,
        promptings=_among(args.prompting, "--prompting", PROMPTINGS),
        protocols=_among(args.protocol, "--protocol", PROTOCOLS),
        adaptive=args.adaptive,
        difficulties=args.difficulties,
        shard=parse_shard(args.shard) if args.shard else shard_of_environment(environ),
        limits=Limits(args.max_cost, args.max_tokens, args.max_time),
        concurrency=args.concurrency or usual_concurrency(args),
        executor=args.executor,
        workers=_workers(args),
        episode_timeout_s=args.episode_timeout,
        out=args.out,
        resume=args.resume,
        allow_modified=args.allow_modified,
        dry_run=args.dry_run,
        otel=args.otel,
        as_json=args.json,
    )
    _check_size(config)
    return config


def _check_size(config: RunConfig) -> None:
    """Refuse a matrix whose keys alone would fill the memory.

    Raises:
        UsageError: The matrix has more than `MOST_EPISODES` episodes.
    """
    sizes = (config.agents, config.packs, config.seeds, config.budgets, config.promptings, config.protocols)
    total = math.prod(map(len, sizes)) * config.epochs
    if total > MOST_EPISODES:
        raise UsageError(
            f"{len(config.packs)} scenes, {len(config.seeds):,} seeds and the other options make {total:,} episodes; a"
            f" run has at most {MOST_EPISODES:,}: choose fewer with --scenes and --seeds"
        )


def _selected(args: argparse.Namespace) -> Selected:
    """Select the split, packs and seeds to play.

    Raises:
        UsageError: An option is malformed, selects nothing or contradicts another one.
    """
    if args.seed_key is not None:
        if args.split not in {None, HELD_BACK}:
            raise UsageError(f"--seed-key: its seeds are those of the split {HELD_BACK}, not of {args.split}")
        packs = parse_scenes(args.scenes or SUITE, args.scenes_dir)
        if any(is_world(files.scene_id) for files in packs):
            raise UsageError(
                "--seed-key: worlds are held back by the key that `worlds make --key-file` draws them with"
            )
        return Selected(HELD_BACK, tuple(packs), parse_numbers(args.seeds or f"0-{USUAL_SEEDS - 1}", "--seeds", 0))
    return select(args.split, args.scenes, args.seeds, args.scenes_dir)


def _spare_seeds(args: argparse.Namespace) -> range:
    """Return the seeds of the split or seed key that follow the default seeds; none if `--seeds` is given."""
    if args.seeds is not None:
        return range(0)
    if args.seed_key is not None:
        return range(USUAL_SEEDS, SEED_SHIFT)
    return range(0) if args.split is None else find_split(args.split).seeds[USUAL_SEEDS:]


def add_options(run: argparse.ArgumentParser) -> None:
    """Declare all options of `run`."""
    run.add_argument(
        "--server",
        default="stdio",
        metavar="S",
        help="stdio: a server process for each episode (default) · host: one local host for all episodes · the URL of a"
        " host · a command that serves one episode on stdio, with {scene} and {seed} in it",
    )
    run.add_argument("--config", metavar="FILE", help="TOML file with options; options of the command line win")
    matrix = run.add_argument_group("the matrix")
    _matrix(matrix)
    add_adaptive_options(matrix)
    add_model_options(run.add_argument_group("models"))
    _course(run.add_argument_group("how it is played"))
    add_external_options(run)


def _matrix(group: OptionGroup) -> None:
    group.add_argument(
        "--agent", action="append", metavar="A", help=f"{' · '.join(AGENTS)} (default reference); may be repeated"
    )
    group.add_argument(
        "--scenes",
        "--scene",
        metavar="SEL",
        help="such as 7-111 · 7,9 · easy · hard · open · category:easy-single · world:5:0-9"
        f" (default {SUITE}: all but open worlds)",
    )
    group.add_argument("--budgets", default="20", metavar="N,…", help="iteration budgets (default 20)")
    group.add_argument(
        "--seeds", metavar="N,…", help="variants of each scene, such as 0 or 1-20 (default 0, or those of --split)"
    )
    group.add_argument(
        "--split",
        metavar="NAME",
        help=f"scenes and seeds of a split: {' · '.join(splits())}; --scenes and --seeds then choose among them (by"
        f" default all its scenes and its first {USUAL_SEEDS} seeds)",
    )
    group.add_argument(
        "--seed-key",
        type=Path,
        metavar="FILE",
        help=f"play the split {HELD_BACK}: the key in FILE gives the seeds, --seeds then numbers the variants (default"
        f" 0-{USUAL_SEEDS - 1}), and the records tell neither the seeds nor what is right",
    )
    unproved(group)
    group.add_argument(
        "--epochs", type=count_of("epochs"), default=1, metavar="N", help="repetitions of each episode (default 1)"
    )
    _conditions(group)
    group.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")


def _conditions(group: OptionGroup) -> None:
    group.add_argument(
        "--prompting", default="zero-shot", metavar="P,…", help=f"{' · '.join(PROMPTINGS)} (default zero-shot)"
    )
    group.add_argument(
        "--protocol",
        default="native",
        metavar="P,…",
        help="native: tool calls of the provider · text: JSON lists in prose (default native)",
    )
    group.add_argument(
        "--stopping",
        default="always",
        metavar="P",
        help=f"{' · '.join(POLICIES)}: when agents are advised to answer (default always: no advice)",
    )
    group.add_argument(
        "--presentation",
        default="",
        metavar="C,…",
        help=f"{' · '.join(Change)}: play the episodes in other words, with other ids of objects, with lists of"
        " objects reversed, or with tools that use cm, ms and g; `compare` with a run without it shows whether that"
        " matters (default: none)",
    )
    group.add_argument(
        "--observations",
        choices=("text", "rgb"),
        default="text",
        help="rgb: results of step and find_objects carry a picture of what may be seen, which models are shown and the"
        " run folder keeps (default text)",
    )


def _course(group: OptionGroup) -> None:
    group.add_argument(
        "--concurrency",
        type=count_of("episodes"),
        metavar="N",
        help=f"episodes played at a time (default {USUAL_CONCURRENCY}; with --sealed, one for each user)",
    )
    group.add_argument(
        "--executor",
        choices=("local", "ray"),
        default="local",
        help="local: on this machine (default) · ray: by workers on the Ray cluster at RAY_ADDRESS",
    )
    group.add_argument(
        "--workers",
        type=count_of("workers"),
        metavar="N",
        help="processes that play, each with a host of its own with --server host; 1 for none besides this one"
        " (default: one for each processor, but fewer for short runs, few episodes at a time, or little memory)",
    )
    group.add_argument(
        "--episode-timeout",
        type=seconds,
        default=7200.0,
        metavar="S",
        help="wall time of one attempt at an episode [s] (7200)",
    )
    group.add_argument("--max-cost", type=us_dollars, metavar="USD", help="start no more episodes once this is spent")
    group.add_argument(
        "--max-tokens",
        type=count_of("tokens"),
        metavar="N",
        help="start no more episodes once so many input and output tokens are used",
    )
    group.add_argument(
        "--max-time", type=seconds, metavar="S", help="start no more episodes once this wall time has passed [s]"
    )
    group.add_argument(
        "--shard",
        metavar="i/n",
        help="play the i-th of n parts, into a folder of its own (default: the index that Slurm or Kubernetes gives)",
    )
    group.add_argument("--out", type=folder_to_write, metavar="DIR", help="run folder (default runs/TIME-AGENT)")
    group.add_argument("--resume", action="store_true", help="continue the run in --out")
    allow_modified(group)
    group.add_argument(
        "--otel",
        action="store_true",
        help="send spans of episodes, turns, requests and calls to the collector at OTEL_EXPORTER_OTLP_ENDPOINT; needs"
        " the extra `otel`",
    )
    group.add_argument("--dry-run", action="store_true", help="print the matrix and an estimate, and play nothing")
    group.add_argument(
        "--json", action="store_true", help="print the summary as JSON on stdout, everything else on stderr"
    )


def long_options(run: argparse.ArgumentParser) -> set[str]:
    """Return the long options of a parser, which a study file may set."""
    return {word for action in run._actions for word in action.option_strings if word.startswith("--")}  # noqa: SLF001  # pyright: ignore[reportPrivateUsage] - argparse has no public list


def _workers(args: argparse.Namespace) -> int | None:
    """The number of workers; None for the default.

    Raises:
        UsageError: The other options cannot be combined with workers.
    """
    if args.otel and args.executor == "local":
        if args.workers is not None and args.workers > 1:
            raise UsageError("--otel: workers export no spans; leave --workers out")
        return 1
    if args.workers is None or args.workers == 1:
        return args.workers
    if args.executor == "ray":
        raise UsageError("--workers: Ray has a worker for each processor of its cluster; leave --workers out")
    if EXTERNAL in (args.agent or ()):
        raise UsageError("--workers: external agents are processes of their own already; leave --workers out")
    if not process_executor.AVAILABLE:
        raise UsageError("--workers: this system does not have what worker processes need; use shards")
    return args.workers


def _among(text: str, option: str, known: tuple[str, ...]) -> tuple[str, ...]:
    chosen = tuple(dict.fromkeys(part.strip() for part in text.split(",")))
    for name in chosen:
        if name not in known:
            raise UsageError(f"{option} {name}: must be one of {', '.join(known)}")
    return chosen
