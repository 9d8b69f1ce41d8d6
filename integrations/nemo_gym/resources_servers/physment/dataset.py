"""Writes a dataset: a row with prompt and tools for each variant.

python -m physment_nemo_gym.dataset --scenes 7,21-30 --seeds 1-20 > train.jsonl
python -m physment_nemo_gym.dataset --split train --random-seeds 1-1000 > train.jsonl
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from physment_referee import OpenedEpisode, Referee, RefereeError, read_variants


def row(opened: OpenedEpisode, variant: dict[str, Any]) -> dict[str, Any]:
    """Return a row of a NeMo Gym dataset.

    Args:
        opened: An episode of this variant.
        variant: The requested variant. The row names it by its index in the split instead of a random seed, so that the
            row is reproducible.
    """
    tools = [
        {
            "type": "function",
            "name": tool["name"],
            "description": tool["description"],
            "parameters": tool["input_schema"],
            "strict": False,
        }
        for tool in opened.tools
    ]
    asked = {"input": [{"role": "user", "content": opened.prompt}], "tools": tools, "parallel_tool_calls": False}
    drawn = {name: value for name, value in variant.items() if name not in {"scene", "seed", "random_seed"}}
    named = {**drawn, "split": opened.split, "index": opened.index} if opened.split else variant
    return {"responses_create_params": asked, "verifier_metadata": {**named, "budget": opened.budget}}


def main() -> int:
    """Write the rows to stdout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default="", help="ids and ranges such as 7,21-30")
    parser.add_argument("--seeds", default="", help="ids and ranges (default 1)")
    parser.add_argument("--split", default="", help="a split, such as train, whose variants the following name")
    parser.add_argument("--levels", default="", help="levels of generated worlds, such as 1-3, instead of scenes")
    parser.add_argument("--indices", default="", help="indices in the split or the level, such as 0-99")
    parser.add_argument("--random-seeds", default="", help="numbers such as 1-100; each draws an index")
    parser.add_argument(
        "--pairs",
        type=Path,
        help='a file with a line such as {"scene": 7, "seed": 3} or {"split": "train", "index": 0} for each row',
    )
    parser.add_argument("--budget", type=int, default=20, help="iterations (default %(default)s)")
    args = parser.parse_args()
    referee = Referee.from_environment()
    try:
        places = {
            "split": args.split,
            "levels": args.levels,
            "indices": args.indices,
            "random_seeds": args.random_seeds,
        }
        for variant in read_variants(args.scenes, args.seeds, args.pairs, **places):
            opened = referee.open(**variant, budget=args.budget)
            referee.close(opened.episode_id, opened.owner_token)
            print(json.dumps(row(opened, variant)))
    except (RefereeError, ValueError) as error:
        print(f"dataset: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
