"""`physment-eval [run]`: plays the matrix, grades it and writes the report; `--dry-run` prints an estimate instead.

Seeds that no certificate covers are checked before they are played.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import count

from evaluator.answers.keys import KeyRing
from evaluator.certify.records import engine_note
from evaluator.certify.seed_proofs import SeedProver, Variant
from evaluator.commands.adaptive import adaptive_config
from evaluator.commands.base import Commands, progress_bar, results_console, run_async
from evaluator.commands.playing import PreparedRun, create_folder, play_run, require_otel
from evaluator.commands.run_options import add_options, read_options
from evaluator.errors import UsageError
from evaluator.records.episode import EpisodeKey
from evaluator.records.run import SEED_SHIFT, AdaptivePlan, Plan, SeedProofs
from evaluator.study.meter import Meter
from evaluator.study.ray_executor import require_ray
from evaluator.study.run_config import RunConfig, participants_of
from evaluator.study.shards import WHOLE, Shard
from scenes import USUAL_TIMESTEP_S, PackError, PackFiles, default_folder, timestep_of

_DESCRIPTION = """\
Play agents in scenes, grade their answers, and write the report. The word `run` may be left out.

  physment-eval run --server stdio                 the reference agent in every scene
  physment-eval run --server host --agent blind --seeds 1-20 --concurrency 8
  physment-eval run --agent scripted:turns.json --scenes 7,21 --budgets 5,10
  physment-eval run --agent model:gpt-5.5 --budgets 5,10,15,20 --server host --concurrency 50 --max-cost 100
  physment-eval run --agent external --scenes 7 -- my-agent --mcp-config {mcp_config} {prompt}
  physment-eval run --config study.toml --dry-run  the size of a study, without playing it
  physment-eval run --out runs/mine --resume       continue after an interruption (same options)

The matrix is every agent in every scene at every seed and budget. A run is a folder: run.json, episodes.jsonl,
grades.jsonl, summary.json, report.html. `physment-eval --help` lists the other commands.
Exit code: 0 all episodes are recorded; 1 some are not; 2 wrong usage; 130 interrupted.
"""

CHARACTERS_PER_TOKEN = 4
"""Characters per token, a rule of thumb for English and JSON."""
PROMPT_TOKENS = 20_700 // CHARACTERS_PER_TOKEN
"""Tokens of 26 tool schemas (18,700 characters) and an opening prompt (2,000, mean of the suite); checked by a test."""
TURN_TOKENS = 2_600 // CHARACTERS_PER_TOKEN
"""Tokens added to the conversation by each turn, measured on the reference agent, which makes many calls. In the
authors' logs of models, visible replies and results had 760 characters a turn. Hidden reasoning is not counted."""


def estimate_lines(plan: Plan, keys: Sequence[EpisodeKey], shard: Shard, concurrency: int) -> list[str]:
    """Return lines that describe the size of a run, with upper bounds of its tokens.

    Args:
        plan: The whole matrix.
        keys: Keys of the episodes of this shard.
        shard: The part of the matrix to play.
        concurrency: Number of episodes played at a time.
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
    """Return the input tokens of an episode that uses its whole budget. Every request contains all earlier turns."""
    return budget * PROMPT_TOKENS + TURN_TOKENS * budget * (budget - 1) // 2


def add(commands: Commands) -> None:
    """Declare the default command, `run`. Its help text is that of the whole program."""
    run = commands.add_parser(
        "run",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    run.set_defaults(run=_run)
    add_options(run)


def _run(args: argparse.Namespace) -> int:
    config = read_options(args)
    answers, table = KeyRing(config.scenes_dir, config.seed_of), None
    if config.difficulties is not None and config.adaptive is None:
        raise UsageError("--difficulties needs --adaptive SE")
    if config.adaptive is not None:
        config, table = adaptive_config(config, answers)
    participants = participants_of(config)
    plan = config.plan(participants)
    if config.adaptive is not None and table is not None:
        design = AdaptivePlan(se=config.adaptive, difficulties_sha256=table.sha256)
        plan = plan.model_copy(update={"adaptive": design})
    if config.dry_run:
        keys = [key for key in plan.matrix() if config.shard.takes(key)]
        print(*estimate_lines(plan, keys, config.shard, config.concurrency), sep="\n")
        return 0
    if config.otel:
        if config.executor == "ray":
            raise UsageError("--otel: the workers of --executor ray export no spans; play with --executor local")
        require_otel()
    if config.executor == "ray":
        require_ray()
    for note in (*_timestep_notes(config.packs), engine_note(config.scenes_dir or default_folder())):
        if note:
            print(f"physment-eval: {note}", file=sys.stderr)
    plan, proofs = prove_seeds(config, plan)
    keys = [key for key in plan.matrix() if config.shard.takes(key)]
    folder = create_folder(config, participants)
    console, meter = results_console(as_json=config.as_json), Meter(config.limits)
    run = PreparedRun(
        config, participants, plan, keys, folder, answers, meter, console, seed_proofs=proofs, table=table
    )
    return play_run(run)


def _timestep_notes(packs: Iterable[PackFiles]) -> Iterator[str]:
    """Return a note for each model whose time step differs from that of the paper and the suite.

    Raises:
        UsageError: A model cannot be read.
    """
    try:
        counts = Counter(timestep_of(files) for files in packs if files.mjcf.is_file())
    except PackError as error:
        raise UsageError(str(error)) from error
    for step, number in sorted(counts.items()):
        if step != USUAL_TIMESTEP_S:
            scenes = "1 scene runs" if number == 1 else f"{number} scenes run"
            command = f"physment-mcp --timestep {USUAL_TIMESTEP_S:g} --scenes-dir DIR --scene {{scene}} --seed {{seed}}"
            yield (
                f"{scenes} with the time step of the model, {step:g} s; the paper has {USUAL_TIMESTEP_S:g} s. To force"
                f" it: --server '{command}'"
            )


_NAMED = 3
"""Largest number of seeds that a refusal names."""


def prove_seeds(config: RunConfig, plan: Plan) -> tuple[Plan, SeedProofs]:
    """Check those seeds of a plan that no certificate covers.

    A seed that fails is replaced, unless the operator named it.

    Args:
        config: The configuration of the run.
        plan: Its episodes.

    Returns:
        The plan with replaced seeds, and the results of the checks, which are stored in the record of the run.

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
    said = "proving seeds that no certificate covers (--unproved skips this)"
    with progress_bar() as bar:
        if bar.disable:
            print(f"physment-eval: {said}", file=sys.stderr)
        while todo:
            task = bar.add_task(said, total=len(todo))
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
