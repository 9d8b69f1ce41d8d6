# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false
"""Data sets for trainers: one row per variant, with prompt, tools and the transcript of the reference agent.

Each scene is written only for the first split that contains it, so no structure occurs in two splits.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evaluator.agents.reference import ReferenceAgent
from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import ToolDescription
from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import StoreError
from evaluator.records.episode import Episode, EpisodeKey, Verdict, Versions
from evaluator.referee.contract import Variant
from evaluator.referee.variants import Variants
from evaluator.scores.scoring import grade_record
from evaluator.study.selection import find_split
from scenes import CANARY, find_pack, pack_hash

SPLITS = ("train", "validation", "test")
"""Splits that are written, each without the scenes of those before it."""
WITH_REFERENCE = ("train", "validation")
"""Splits whose rows contain the reference transcript. In `test`, transcripts would reveal the answers."""
COLUMNS = {
    "id": "`train@1/0`: split and index",
    "split": "name and version of the split",
    "index": 'place in the split: `POST /episodes {"split": …, "index": …}` opens this variant',
    "scene": "id of the scene",
    "prompt": "the opening prompt, with a budget of 20 iterations",
    "tools": "JSON: the tools in the format of chat completions",
    "reference": "JSON: the messages of the reference protocol after the prompt, in that format; null in `test`",
    "metadata": "JSON: rung, category, answer_parts, chance, calls and iterations of the reference",
}
Row = dict[str, Any]
_EVALUATED = SPLITS[-1]
_BENCHMARK = f"""\
name: PhysMent
description: >
  Physical reasoning by experiment: an agent gets a MuJoCo laboratory with 26 tools, finds out by measurements what a
  question needs, and answers once. The data set has the opening prompts and the tools; the laboratory is a program,
  physment-mcp.
evaluation_framework: inspect-ai
tasks:
  - id: physment
    config: default
    split: {_EVALUATED}
"""
"""Format: https://huggingface.co/docs/hub/eval-results. The plugin physment-inspect has the task for Inspect AI."""


@dataclass(slots=True)
class WrittenSplit:
    """The files and counts of one written split."""

    label: str
    scenes: int = 0
    rows: int = 0
    left_out: list[str] = field(default_factory=list[str])
    """Ids of variants that the reference agent does not solve; they get no row."""
    files: list[Path] = field(default_factory=list[Path])


async def write_tasks(
    folder: Path, laboratory: EpisodeConnector, variants: Variants, per_scene: int, scenes: Sequence[int] | None = None
) -> list[WrittenSplit]:
    """Write the rows of all splits as JSON lines, as Parquet if pyarrow is installed, and a data card.

    With the split `test`, also writes `eval.yaml`, by which the Hugging Face Hub lists a data set as a benchmark.

    Args:
        folder: Existing folder to write to.
        laboratory: Laboratory on which the reference protocols are played.
        variants: The variants, with their answer keys.
        per_scene: Number of seeds of each scene.
        scenes: The scenes to write; None for all.

    Raises:
        StoreError: A file cannot be written.
        InfrastructureError: The server failed.
    """
    done: list[WrittenSplit] = []
    seen: set[int] = set()
    for name in SPLITS:
        split = find_split(name)
        chosen = [scene for scene in split.scenes if scene not in seen and (scenes is None or scene in scenes)]
        seen.update(split.scenes)
        if not chosen:
            continue
        written = WrittenSplit(split.label, len(chosen))
        rows: list[Row] = []
        for place, seed in enumerate(split.seeds[:per_scene]):
            for scene in chosen:
                index = split.scenes.index(scene) + len(split.scenes) * place
                variant = Variant(scene, seed, split.label, index)
                row = await _row(laboratory, variants, variant, with_reference=name in WITH_REFERENCE)
                if row is None:
                    written.left_out.append(f"{split.label}/{index}")
                else:
                    rows.append(row)
        written.rows = len(rows)
        try:
            written.files = list(_write(folder / name, rows))
        except OSError as error:
            raise StoreError(f"{folder} cannot be written: {error.strerror or error}") from error
        done.append(written)
    try:
        (folder / "README.md").write_text(card(done, per_scene), encoding="utf-8")
        if any(split.label.startswith(f"{_EVALUATED}@") for split in done):
            (folder / "eval.yaml").write_text(_BENCHMARK, encoding="utf-8")
    except OSError as error:
        raise StoreError(f"{folder} cannot be written: {error.strerror or error}") from error
    return done


async def _row(
    laboratory: EpisodeConnector, variants: Variants, variant: Variant, *, with_reference: bool
) -> Row | None:
    """Play a variant with its reference protocol; returns its row, or None if the answer is not correct."""
    keys: KeyRing = variants.keys
    agent = ReferenceAgent(keys.folder)
    key = EpisodeKey(scene=variant.scene, seed=variant.seed, agent=agent.name, budget=20)
    pack = pack_hash(find_pack(variant.scene, keys.folder))
    versions = Versions(physment=version("physment-mcp"), protocol="", pack=pack)
    async with laboratory.open(variant.scene, variant.seed) as client:
        tools = (await (toolboxes := laboratory.toolboxes or Toolboxes()).of(client, variant.scene)).tools
        played = await play_episode(agent, client, key, versions, toolboxes)
    if grade_record(played, keys).grade.strict is not Verdict.CORRECT:
        return None
    facts = variants.facts(variant.scene)
    calls = sum(len(turn.exchanges) for turn in played.turns)
    metadata = {
        **{name: getattr(facts, name) for name in ("rung", "category", "answer_parts", "chance")},
        "reference_iterations": len(played.turns),
        "reference_calls": calls,
    }
    return {
        "id": f"{variant.split}/{variant.index}",
        "split": variant.split,
        "index": variant.index,
        "scene": variant.scene,
        "prompt": played.prompt,
        "tools": _json([_described(tool) for tool in tools]),
        "reference": _json(list(messages_of(played))) if with_reference else None,
        "metadata": _json(metadata),
    }


def messages_of(played: Episode) -> Iterator[dict[str, Any]]:
    """The messages of an episode after its prompt, in the format of chat completions."""
    for number, turn in enumerate(played.turns):
        calls = [
            {
                "id": f"call_{number}_{place}",
                "type": "function",
                "function": {"name": exchange.call.tool, "arguments": _json(exchange.call.arguments)},
            }
            for place, exchange in enumerate(turn.exchanges)
        ]
        yield {"role": "assistant", "content": turn.reasoning, "tool_calls": calls}
        for call, exchange in zip(calls, turn.exchanges, strict=True):
            yield {"role": "tool", "tool_call_id": call["id"], "content": exchange.text}


def _described(tool: ToolDescription) -> dict[str, Any]:
    function = {"name": tool.name, "description": tool.description, "parameters": tool.input_schema}
    return {"type": "function", "function": function}


def _write(stem: Path, rows: Sequence[Row]) -> Iterator[Path]:
    """Write the rows of a split; yields the files."""
    lines = stem.with_suffix(".jsonl")
    lines.write_text("".join(_json(row) + "\n" for row in rows), encoding="utf-8")
    yield lines
    if has_parquet() and rows:
        arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
        kinds = {"index": arrow.int64(), "scene": arrow.int64()}
        schema = arrow.schema([(name, kinds.get(name, arrow.string())) for name in COLUMNS])
        parquet.write_table(arrow.Table.from_pylist(list(rows), schema=schema), stem.with_suffix(".parquet"))
        yield stem.with_suffix(".parquet")


def has_parquet() -> bool:
    """Whether Parquet files can be written."""
    return find_spec("pyarrow") is not None


def card(done: Sequence[WrittenSplit], per_scene: int) -> str:
    """The data card: the content of the files, how they were made, and what they must not be used for."""
    configs = "".join(
        f"      - split: {split.label.partition('@')[0]}\n        path: {split.files[0].name}\n" for split in done
    )
    table = "".join(
        f"| {split.label} | {split.scenes} | {split.rows} | {_size_mb(split):.1f} MB |"
        f" {', '.join(split.left_out) or '–'} |\n"
        for split in done
    )
    columns = "".join(f"| `{name}` | {meaning} |\n" for name, meaning in COLUMNS.items())
    return f"""---
configs:
  - config_name: default
    data_files:
{configs}---

# Tasks of the PhysMent laboratory

Made by `physment-eval export --to tasks --per-scene {per_scene}` of physment-mcp {version("physment-mcp")}. A row is a
variant of a scene: its prompt, its tools, and how its reference protocol solves it. Rewards come from
`physment-eval referee`.

| split | scenes | rows | size | left out, because the reference does not solve them |
|---|---|---|---|---|
{table}
No scene is in two of these files, and the ideas of `test` occur in no other. Train on `train` alone.

| column | meaning |
|---|---|
{columns}
The files have neither seeds nor keys, but the transcripts in `train` and `validation` end with the right answers.
Canary, for filters of training corpora: `{CANARY}`.
"""


def _size_mb(split: WrittenSplit) -> float:
    return sum(file.stat().st_size for file in split.files) / 1e6


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
