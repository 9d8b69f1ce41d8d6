"""`--dry-run`: the size of a matrix, and the most that it can use."""

from collections.abc import Sequence

from evaluator.records.episode import EpisodeKey
from evaluator.records.run import Plan
from evaluator.study.shards import WHOLE, Shard

CHARACTERS_PER_TOKEN = 4
"""A rule of thumb for English and JSON."""
PROMPT_TOKENS = 20_700 // CHARACTERS_PER_TOKEN
"""26 tool schemas (18,700 characters) and an opening prompt (2,000, mean of the suite). A test checks the sizes."""
TURN_TOKENS = 2_600 // CHARACTERS_PER_TOKEN
"""Added to the conversation by each turn: measured on the reference agent, which makes many calls. In the authors'
logs of models, visible replies and returns were 760 characters a turn. Thoughts are not counted."""


def estimate_lines(plan: Plan, keys: Sequence[EpisodeKey], shard: Shard, concurrency: int) -> list[str]:
    """The matrix in words, with upper bounds.

    Args:
        plan: The whole matrix.
        keys: The episodes to be played here.
        shard: Which part of the matrix these are.
        concurrency: Episodes at a time.
    """
    sizes = (
        ("scenes", len(plan.scenes)),
        ("agents", len(plan.agents)),
        ("budgets", len(plan.budgets)),
        ("seeds", len(plan.seeds)),
        ("promptings", len(plan.promptings)),
        ("protocols", len(plan.protocols)),
        ("epochs", plan.epochs),
    )
    total = len(plan.matrix())
    lines = [" × ".join(f"{count} {name}" for name, count in sizes) + f" = {total} episodes"]
    if shard != WHOLE:
        lines.append(f"shard {shard.index}/{shard.count}: {len(keys)} of them")
    lines.append(f"at most {sum(key.budget for key in keys)} iterations, {concurrency} episodes at a time")
    asked = [key for key in keys if "model:" in key.agent]
    if asked:
        requests = sum(key.budget for key in asked)
        tokens = sum(input_tokens(key.budget) for key in asked)
        lines.append(
            f"models: at most {requests} requests and about {tokens / 1e6:.1f} million input tokens if every budget is"
            f" used up, most of them cached where the provider caches; half the iterations take about a third of it"
        )
    return lines


def input_tokens(budget: int) -> int:
    """Input tokens of an episode that uses its whole budget: every request contains the conversation so far."""
    return budget * PROMPT_TOKENS + TURN_TOKENS * budget * (budget - 1) // 2
