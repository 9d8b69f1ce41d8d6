# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownArgumentType=false
"""Exports a run as a Parquet file with one row for each tool call, for analysis across many runs."""

import json
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evaluator.errors import StoreError, UsageError
from evaluator.records.episode import Episode, GradeRecord
from evaluator.records.run import RunRecord
from scenes import reference_of

_EPISODES_AT_A_TIME = 200
"""Number of episodes in a row group. A larger file is written in several groups to limit memory."""

COLUMNS: dict[str, str] = {
    "scene": "int32",
    "reference": "string",
    "seed": "int64",
    "agent": "string",
    "budget": "int32",
    "prompting": "string",
    "protocol": "string",
    "epoch": "int32",
    "pack": "string",
    "outcome": "string",
    "answer": "string",
    "strict": "string",
    "normalised": "string",
    "graded": "float64",
    "law_equivalent": "bool",
    "turn": "int32",
    "call": "int32",
    "reasoning": "string",
    "note": "string",
    "tool": "string",
    "arguments": "string",
    "returned": "bool",
    "is_error": "bool",
    "sim_time": "float64",
    "content": "string",
    "text": "string",
    "duration_s": "float64",
}
"""Column → type.

`reference` is what `--scenes` calls the scene, such as `world:5:3`. Texts of `answer`, `arguments` and `content` are
JSON. `law_equivalent` is null if no law was stated. `turn` and `call` count from 1; `reasoning` and `note` belong to
the turn and repeat for each of its calls. A turn without calls has no row.
"""


def write_parquet(file: Path, run: RunRecord, graded: Sequence[tuple[Episode, GradeRecord]]) -> int:
    """Write the exchanges of a run; returns how many there are.

    Args:
        file: Path of the file, which is replaced atomically.
        run: The run's record, stored in the file's metadata under `physment_run`.
        graded: The run's episodes with their grades.

    Raises:
        UsageError: pyarrow is not installed.
        StoreError: The file cannot be written.
    """
    if find_spec("pyarrow") is None:
        raise UsageError("--to parquet needs pyarrow, which is not installed: pip install 'physment-mcp[parquet]'")
    arrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    types = {"bool": "bool_"}
    fields = [(name, getattr(arrow, types.get(kind, kind))()) for name, kind in COLUMNS.items()]
    schema = arrow.schema(fields, metadata={"physment_run": run.model_dump_json()})
    fresh, count = file.with_name(f".{file.name}.new"), 0
    try:
        with parquet.ParquetWriter(fresh, schema, compression="zstd") as writer:
            for start in range(0, len(graded), _EPISODES_AT_A_TIME):
                rows = [row for pair in graded[start : start + _EPISODES_AT_A_TIME] for row in exchange_rows(*pair)]
                writer.write_table(arrow.Table.from_pylist(rows, schema=schema))
                count += len(rows)
        fresh.replace(file)
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror or error}") from error
    return count


def exchange_rows(episode: Episode, record: GradeRecord) -> Iterator[dict[str, Any]]:
    """Yield a row for each tool call of an episode, as a mapping of columns to values."""
    whole = {
        **episode.key.model_dump(),
        "reference": reference_of(episode.key.scene),
        "pack": episode.versions.pack,
        "outcome": episode.outcome.value,
        "answer": None if episode.answer is None else _json(episode.answer),
        "strict": record.grade.strict.value,
        "normalised": record.grade.normalised.value,
        "graded": record.grade.graded,
        "law_equivalent": None if record.law is None else record.law.equivalent,
    }
    for number, turn in enumerate(episode.turns, start=1):
        for index, exchange in enumerate(turn.exchanges, start=1):
            content = exchange.content
            yield {
                **whole,
                "turn": number,
                "call": index,
                "reasoning": turn.reasoning,
                "note": turn.note,
                "tool": exchange.call.tool,
                "arguments": _json(exchange.call.arguments),
                "returned": exchange.returned,
                "is_error": exchange.is_error,
                "sim_time": None if content is None else content.get("sim_time"),
                "content": None if content is None else _json(content),
                "text": exchange.text,
                "duration_s": exchange.duration_s,
            }


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))
