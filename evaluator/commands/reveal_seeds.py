"""`physment-eval reveal-seeds`: discloses the held-back seeds of a run, or checks the disclosed ones."""

import argparse
import json
from pathlib import Path

from evaluator.commands.base import Commands
from evaluator.errors import UsageError
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import read_revealed, reveal, seed_key_file, seeds_of
from scenes import reference_of

_DESCRIPTION = """\
Disclose the seeds of a run that was played with --seed-key, or check what its publisher disclosed.

  physment-eval reveal-seeds runs/mine --seed-key held-back.key   write the key into the folder and print the seeds
  physment-eval reveal-seeds runs/mine                            check the disclosed key and print the seeds

The key must fit the commitment in run.json, which was published with the run. Afterwards everybody can grade and replay
the run; `physment-eval grade` then writes the keys and the reasons that its grades lack. One line for each variant:
scene, number, seed. Exit code: 0 the key fits; 2 it does not, or there is none.
"""


def add(commands: Commands) -> None:
    """Declare the command `reveal-seeds` and its options."""
    command = commands.add_parser(
        "reveal-seeds",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_reveal_seeds)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument("--seed-key", type=Path, metavar="FILE", help="the key that the run was played with")
    command.add_argument("--json", action="store_true", help="print the seeds as JSON")


def _reveal_seeds(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    plan = folder.read_run().plan
    if not plan.held_back:
        raise UsageError(f"{args.folder} was not played on held-back seeds: its records hold its seeds")
    if args.seed_key is not None:
        known = read_revealed(folder)
        reveal(folder, args.seed_key)
        if known is None:
            print(f"the key is written to {seed_key_file(folder)}")
    seed_of = seeds_of(folder, None)
    variants = sorted({(key.scene, key.seed) for key in plan.matrix()})
    if args.json:
        rows = [{"scene": scene, "number": number, "seed": seed_of(scene, number)} for scene, number in variants]
        print(json.dumps({"commitment": plan.held_back, "seeds": rows}))
    else:
        print(f"the key fits the commitment of the run, {plan.held_back}")
        for scene, number in variants:
            print(reference_of(scene), number, seed_of(scene, number))
    return 0
