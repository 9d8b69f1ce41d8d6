"""Checks the seeds of a run that no certificate covers, before `run` plays them."""

import sys
from collections.abc import Generator, Iterable, Sequence
from contextlib import contextmanager
from itertools import count

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from evaluator.certify.seed_proofs import SeedProver, Variant
from evaluator.commands.base import run_async
from evaluator.errors import UsageError
from evaluator.records.run import SEED_SHIFT, Plan, SeedProofs
from evaluator.study.run_config import RunConfig

_NAMED = 3
"""Largest number of seeds that a refusal names."""


def prove_seeds(config: RunConfig, plan: Plan) -> tuple[Plan, SeedProofs]:
    """Check the seeds of a plan that no certificate covers.

    A seed that fails is replaced, unless the operator named it.

    Args:
        config: The configuration of the run.
        plan: Its episodes.

    Returns:
        The plan with replaced seeds, and the entry about the proofs for the record of the run.

    Raises:
        UsageError: A seed that the operator named fails, or there is no seed left to replace another one.
    """
    prover = SeedProver(config.packs, config.scenes_dir, config.seed_of, plan.held_back, skip=config.unproved)
    wanted = list(dict.fromkeys((key.scene, key.seed) for key in plan.matrix()))
    if any(prover.needs_proof(*variant) for variant in wanted):
        replaced = run_async(lambda: _replaced(prover, config, wanted))
        plan = plan.model_copy(update={"replaced": replaced})
    return plan, prover.record((key.scene, key.seed) for key in plan.matrix())


async def _replaced(prover: SeedProver, config: RunConfig, wanted: Sequence[Variant]) -> dict[str, dict[int, int]]:
    """Check variants; return, for each scene, each failed seed with the seed that replaces it.

    Raises:
        UsageError: There is no seed left to replace one that fails.
    """
    packs = {files.scene_id: files for files in config.packs}
    taken, stands_for = set(wanted), dict(zip(wanted, wanted, strict=True))
    replaced: dict[str, dict[int, int]] = {}
    todo = [variant for variant in wanted if prover.needs_proof(*variant)]
    with _progress() as bar:
        while todo:
            task = bar.add_task("", total=len(todo))
            variants = [(packs[scene], seed) for scene, seed in todo]
            failed = await prover.prove(variants, lambda _proof, task=task: bar.advance(task))
            todo, refused = list[Variant](), list[str]()
            for (scene, seed), proof in failed.items():
                first = stands_for[scene, seed]
                other = next((spare for spare in _spare(config, first[1]) if (scene, spare) not in taken), None)
                if other is None:
                    refused.append(proof.sentence(scene))
                    continue
                print(f"physment-eval: {proof.sentence(scene)}; seed {other} takes its place", file=sys.stderr)
                taken.add((scene, other))
                stands_for[scene, other] = first
                replaced.setdefault(str(scene), {})[first[1]] = other
                todo += [(scene, other)] if prover.needs_proof(scene, other) else []
            if refused:
                raise UsageError(_refusal(refused))
    return replaced


@contextmanager
def _progress() -> Generator[Progress]:
    console = Console(stderr=True)
    said = "proving seeds that no certificate covers (--unproved skips this)"
    if not console.is_terminal:
        print(f"physment-eval: {said}", file=sys.stderr)
    columns = (TextColumn(said), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        yield bar


def _spare(config: RunConfig, seed: int) -> Iterable[int]:
    """Seeds that may replace a failed seed, in order; none if the operator named it."""
    if seed in config.seeds:
        return config.spare_seeds
    # At each further repetition, an external program plays other seeds, which the operator did not name.
    shift = next(SEED_SHIFT * number for number in count(1) if seed - SEED_SHIFT * number in config.seeds)
    return range(max(config.seeds) + 1 + shift, SEED_SHIFT + shift)


def _refusal(sentences: Sequence[str]) -> str:
    more = f"; {len(sentences) - _NAMED} more cannot" if len(sentences) > _NAMED else ""
    them = "it" if len(sentences) == 1 else "them"
    return f"{'; '.join(sentences[:_NAMED])}{more}: leave {them} out of --seeds, or give --unproved to play {them}"
