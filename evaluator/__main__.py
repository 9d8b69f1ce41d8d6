"""Command line of the evaluator: lists the commands, and turns their errors into exit codes.

All modules of the evaluator are imported inside functions: this takes a second, in which Ctrl-C must be understood.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import NoReturn

_DESCRIPTION = """\
Let agents experiment in the PhysMent laboratory over MCP, grade their answers, and report.

  physment-eval --server stdio                     the reference agent in every scene
  physment-eval --server host --agent blind --seeds 1-20 --concurrency 8
  physment-eval --agent scripted:turns.json --scenes 7,21 --budgets 5,10
  physment-eval --agent model:gpt-5.5 --budgets 5,10,15,20 --server host --concurrency 50 --max-cost 100
  physment-eval --config study.toml --dry-run      the size of a study, without playing it
  physment-eval run --out runs/mine --resume       continue after an interruption (same options)
  physment-eval merge runs/mine --out runs/whole   merge the shards of a run
  physment-eval grade runs/mine                    grade a stored run again
  physment-eval report runs/mine runs/base --out o write report.html for two runs side by side
  physment-eval compare runs/one runs/other        which is better, by how much, and how certainly
  physment-eval play 7                             solve a scene yourself
  physment-eval replay runs/mine                   play its episodes again and compare every return

  physment-eval scenes list                        the scenes, with their certificates
  physment-eval scenes show 21                     what an agent learns about a scene
  physment-eval scenes new 112 --category hard-single --scenes-dir my_scenes
  physment-eval lint --scenes-dir my_scenes        what is wrong with a pack, without running it
  physment-eval verify --scene 112 --scenes-dir my_scenes
                                                   prove a scene sound, on twenty seeds

A run is a folder: run.json, episodes.jsonl, grades.jsonl, summary.json, report.html.
Exit code: 0 all episodes are recorded, or all scenes are sound; 1 some are not; 2 wrong usage; 130 interrupted.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    from evaluator.commands.base import make_room  # noqa: PLC0415
    from evaluator.errors import InfrastructureError, StoreError, UsageError  # noqa: PLC0415

    make_room()
    try:
        args = parsed(sys.argv[1:] if argv is None else argv)
        return args.run(args)
    except (UsageError, StoreError) as error:
        return _fail(str(error), 2)
    except InfrastructureError as error:
        return _fail(str(error), 1)
    except KeyboardInterrupt:
        print("physment-eval: interrupted", file=sys.stderr)
        return 130


def parsed(argv: Sequence[str]) -> argparse.Namespace:
    """The options of a command line; its `run` executes the command.

    Raises:
        UsageError: The study file that the command line names cannot be used.
        SystemExit: The command line is wrong, or asks for help.
    """
    from evaluator.commands import (  # noqa: PLC0415
        compare,
        models,
        play,
        replay,
        replay_original,
        report,
        results,
        run,
        scenes,
        verify,
    )
    from evaluator.commands.base import own_version  # noqa: PLC0415
    from evaluator.commands.run_options import long_options  # noqa: PLC0415
    from evaluator.study.config import with_config  # noqa: PLC0415

    parser = argparse.ArgumentParser(
        "physment-eval", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"physment-eval {own_version()}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    run.add(commands, _DESCRIPTION)
    for command in (results, report, compare, play, verify, scenes, models, replay, replay_original):
        command.add(commands)
    words = list(argv)
    # `run` is the default command: insert it if the first word is not a command.
    if not words or (words[0] not in commands.choices and words[0] not in {"-h", "--help", "--version"}):
        words.insert(0, "run")
    if words[0] == "run":
        words = ["run", *with_config(words[1:], long_options(commands.choices["run"]))]
    return parser.parse_args(words)


def _fail(sentence: str, code: int) -> int:
    print(f"physment-eval: {sentence}", file=sys.stderr)
    return code


def entry() -> NoReturn:
    """Be the program `physment-eval`."""
    try:
        from evaluator.commands.base import end_as_by_ctrl_c  # noqa: PLC0415

        end_as_by_ctrl_c()
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)  # while modules were loaded: nothing has begun, so there is nothing to say


if __name__ == "__main__":
    entry()
