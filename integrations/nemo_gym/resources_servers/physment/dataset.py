"""Writes a dataset: a row with prompt and tools for each pair of a scene and a seed.

python -m physment_nemo_gym.dataset --scenes 7,21-30 --seeds 1-20 > train.jsonl
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from physment_referee import OpenedEpisode, Referee, RefereeError, read_pairs


def row(opened: OpenedEpisode, scene: int, seed: int) -> dict[str, Any]:
    """A row of a dataset of NeMo Gym.

    Args:
        opened: An episode of this scene and seed.
        scene: Its scene.
        seed: Its seed.
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
    pair = {"scene": scene, "seed": seed, "budget": opened.budget}
    return {"responses_create_params": asked, "verifier_metadata": pair}


def main() -> int:
    """Write the rows to stdout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", default="", help="ids and ranges such as 7,21-30")
    parser.add_argument("--seeds", default="1", help="ids and ranges (default %(default)s)")
    parser.add_argument("--pairs", type=Path, help='a file with a line such as {"scene": 7, "seed": 3} for each row')
    parser.add_argument("--budget", type=int, default=20, help="iterations (default %(default)s)")
    args = parser.parse_args()
    referee = Referee.from_environment()
    try:
        for scene, seed in read_pairs(args.scenes, args.seeds, args.pairs):
            opened = referee.open(scene, seed, budget=args.budget)
            referee.close(opened.episode_id, opened.owner_token)
            print(json.dumps(row(opened, scene, seed)))
    except (RefereeError, ValueError) as error:
        print(f"dataset: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
