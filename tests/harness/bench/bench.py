"""Measures speed as ratios of two times in one run: `make bench`.

Each row times both sides alternately in many rounds, and gives the median of the ratios with its quartiles. A ratio
above its aim is marked but is not a failure, because machines differ and other processes disturb the measurement.

python -m tests.harness.bench.bench [PART …] [--out FILE]
"""

import argparse
import json
import logging
import os
import platform
import sys
from collections.abc import AsyncGenerator, Callable, Sequence
from importlib.metadata import version
from pathlib import Path

import anyio
from rich.console import Console
from rich.table import Table

from tests.harness.bench import in_process, opening, starting, stepping, texts, tool_calls, transports
from tests.harness.bench.measuring import Row

PARTS: dict[str, Callable[[], AsyncGenerator[Row]]] = {
    "calls": tool_calls.rows,
    "transports": transports.rows,
    "opening": opening.rows,
    "in-process": in_process.rows,
    "stepping": stepping.rows,
    "starting": starting.rows,
    "texts": texts.rows,
}


async def measure(parts: Sequence[str], console: Console) -> dict[str, list[Row]]:
    """Measure the parts, and print the table of each part as soon as it is complete."""
    measured: dict[str, list[Row]] = {}
    for part in parts:
        measured[part] = [row async for row in PARTS[part]()]
        console.print(_table(part, measured[part]))
        console.print()
    return measured


def _table(part: str, rows: Sequence[Row]) -> Table:
    table = Table(title=f"{part}: medians of rounds measured side by side", title_justify="left", box=None)
    for title in ("what", "ours ms", "against ms", "ratio", "quartiles", "aim"):
        table.add_column(title, justify="left" if title == "what" else "right")
    for row in rows:
        mark = "" if row.ratio <= row.aim else "  above"
        spread = f"{row.spread[0]:.2f} to {row.spread[1]:.2f}" if row.spread else ""
        ours, theirs = f"{1000 * row.ours_s:.3f}", f"{1000 * row.theirs_s:.3f}"
        table.add_row(row.what, ours, theirs, f"{row.ratio:.3f}", spread, f"≤ {row.aim:g}{mark}")
    return table


def _machine() -> dict[str, object]:
    """Describe the machine and the versions on which the figures depend."""
    packages = {name: version(name) for name in ("physment-mcp", "mujoco", "mcp", "numpy")}
    load = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
    return {"python": platform.python_version(), "cores": os.cpu_count(), "load": load, "packages": packages}


def _as_data(measured: dict[str, list[Row]]) -> list[dict[str, object]]:
    return [{"part": part, **row._asdict()} for part, rows in measured.items() for row in rows]


def main(argv: Sequence[str]) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"{' · '.join(PARTS)} (default: all)")
    parser.add_argument("--out", type=Path, default=Path("bench.json"), metavar="FILE", help="figures (bench.json)")
    args = parser.parse_args(argv)
    if unknown := set(args.parts) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    logging.disable(logging.INFO)
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=140)
    measured = anyio.run(measure, args.parts or list(PARTS), console)
    figures = {"machine": _machine(), "rows": _as_data(measured)}
    args.out.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    console.print(f"figures: {args.out}")


if __name__ == "__main__":
    main(sys.argv[1:])
