"""Measures how hard the levels of worlds are: reference agents with and without handicaps answer stored worlds.

Every prediction is written as a line of a file at once, and an interrupted run can continue:
python -m tests.harness.worlds_ladder --worlds-dir DIR [--levels L ...] [--count N] [--references R ...] [--out FILE]

Readings are computed from theory with noise, since the certificate of a world proves that the engine agrees with it.
"""

import argparse
import json
import random
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from evaluator.store.durable import append_line
from scenes.worlds.catalogue import forms_of
from scenes.worlds.experiment import simulated
from scenes.worlds.levels import LEVELS
from scenes.worlds.predictions import Prediction, predicted, weighed
from scenes.worlds.questions import tolerance
from scenes.worlds.records import Certificate, WorldRecord, lines_file, read_certificates, read_records
from scenes.worlds.search import Search
from scenes.worlds.weak_form import Legs, to_unit

NOISE_SEED = 1000
"""Added to the scene id to seed the noise of readings. No certificate uses these seeds; no two worlds share one."""
LINEAR = {"linear drag", "swirl", "wind", "shear", "saddle", "friction", "spring", "slope"}
"""Forms of terms that are linear in position and velocity."""
_BESIDE = 0.05
"""Initial offset of the informed fit from the drawn constants, as a share of their ranges."""


def searched(record: WorldRecord, seconds: float, **changes: Any) -> Search:
    """Search for the terms of a world, with changed limits and instruments."""
    told = replace(record.told, **changes)
    course = simulated(record.structure, record.constants, told, NOISE_SEED + record.scene_id)
    return Search(Legs.of(course, told), seconds=seconds)


def full(record: WorldRecord, seconds: float) -> Prediction:
    """The reference, which knows the grammar."""
    return predicted(searched(record, seconds), record.questions)


def half_looks(record: WorldRecord, seconds: float) -> Prediction:
    """The reference with half of the readings."""
    return predicted(searched(record, seconds, looks=max(6, record.looks // 4 * 2)), record.questions)


def noisy(record: WorldRecord, seconds: float) -> Prediction:
    """The reference with three times the noise."""
    return predicted(searched(record, seconds, noise=3 * record.noise), record.questions)


def unmodulated(record: WorldRecord, seconds: float) -> Prediction:
    """The reference without modulations."""
    search = searched(record, seconds)
    return predicted(Search(search.legs, seconds=seconds, modulations=()), record.questions)


def linear(record: WorldRecord, seconds: float) -> Prediction:
    """The reference without modulations, and with only those forms that are linear in position and velocity."""
    forms = [form for form in forms_of(record.apparatus) if form.name in LINEAR]
    search = searched(record, seconds)
    return predicted(Search(search.legs, seconds=seconds, forms=forms, modulations=()), record.questions)


def informed(record: WorldRecord, seconds: float) -> Prediction:
    """Fit the constants of the known structure, starting near the true constants."""
    search = searched(record, seconds)
    rng = random.Random(record.index)
    unit = np.array([float(to_unit(b, record.constants[name])) for name, b in record.structure.ranges.items()])
    search.tell(record.structure, unit + _BESIDE * np.array([rng.gauss(0, 1) for _ in unit]))
    return weighed(search, search.best(), record.questions)


def one_unknown(record: WorldRecord, seconds: float) -> Prediction:
    """Fit the structure without one of its terms, and search for the missing term."""
    search = searched(record, seconds)
    structure = record.structure
    gone = record.index % len(structure.terms)
    fewer, renamed = structure.without(gone, None)
    kept = {new: value for name, value in record.constants.items() if (new := renamed(name)) is not None}
    unit = np.array([float(to_unit(b, kept[name])) for name, b in fewer.ranges.items()])
    search.tell(fewer, unit)
    search.extend(2)
    return weighed(search, search.best(), record.questions)


REFERENCES: Mapping[str, Callable[[WorldRecord, float], Prediction]] = {
    "informed": informed,
    "one unknown": one_unknown,
    "full": full,
    "half of the looks": half_looks,
    "3 x noise": noisy,
    "no modulations": unmodulated,
    "linear": linear,
}


def measured(record: WorldRecord, certificate: Certificate, reference: str, seconds: float) -> dict[str, Any]:
    """Compare a reference's predictions for a world with its key."""
    begun, key = time.process_time(), np.array(certificate.key)
    found = REFERENCES[reference](record, seconds)
    return {
        "level": record.level, "index": record.index, "record": record.digest, "reference": reference,
        "right": [bool(one) for one in np.abs(found.answer - key) <= tolerance(key)],
        "covered": [bool(one) for one in (found.low <= key) & (key <= found.high)],
        "reduced": round(found.reduced, 3), "known": found.known, "fits": found.tried,
        "weight": round(found.structures.get(record.structure, 0.0), 4),
        "seconds": round(time.process_time() - begun, 1),
    }  # fmt: skip


def table(lines: Iterable[Mapping[str, Any]]) -> str:
    """Tabulate in how many worlds all answers are right, by level and reference; for `full` also interval coverage."""
    cells: dict[int, dict[str, list[Mapping[str, Any]]]] = defaultdict(lambda: defaultdict(list))
    for line in lines:
        cells[line["level"]][line["reference"]].append(line)

    def share(found: list[Mapping[str, Any]]) -> str:
        return f"{sum(all(line['right']) for line in found)}/{len(found)}" if found else "–"

    names = [name for name in REFERENCES if any(name in row for row in cells.values())]
    heads = ["level", *names, "full: answers in 95 % intervals", "full: right of those it explains", "full: CPU s"]
    rows = [heads, ["---"] * len(heads)]
    for level, row in sorted(cells.items()):
        full_lines = row.get("full", [])
        known = [line for line in full_lines if line["known"]]
        covered = [one for line in full_lines for one in line["covered"]]
        seconds = f"{np.median([line['seconds'] for line in full_lines]):.0f}" if full_lines else "–"
        rows.append([
            str(level),
*(share(row[name]) for name in names),
            f"{sum(covered)}/{len(covered)}", share(known), seconds,
        ])  # fmt: skip
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def read_lines(file: Path) -> list[dict[str, Any]]:
    """Read the lines of a run; an incomplete last line is skipped."""
    lines = file.read_text(encoding="utf-8").splitlines(keepends=True) if file.exists() else []
    return [json.loads(line) for line in lines if line.endswith("\n")]


def main() -> int:
    """Measure the worlds that are missing, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--worlds-dir", type=Path, required=True)
    parser.add_argument("--levels", type=int, nargs="+", default=list(LEVELS))
    parser.add_argument("--count", type=int, default=20, help="worlds of a level (default 20)")
    parser.add_argument("--references", nargs="+", choices=list(REFERENCES), default=list(REFERENCES))
    parser.add_argument("--seconds", type=float, default=120.0, help="processor time of a search (default 120)")
    parser.add_argument("--out", type=Path, default=Path("worlds-ladder.jsonl"))
    args = parser.parse_args()
    done = {(line["record"], line["reference"]) for line in read_lines(args.out)}
    for reference in args.references:
        for level in args.levels:
            if not lines_file(args.worlds_dir, level).exists():
                continue
            keys = {one.index: one for one in read_certificates(args.worlds_dir, level)}
            for record in list(read_records(args.worlds_dir, level))[: args.count]:
                if (record.digest, reference) not in done:
                    line = measured(record, keys[record.index], reference, args.seconds)
                    append_line(args.out, json.dumps(line).encode())
                    sys.stderr.write(f"{line}\n")
    sys.stdout.write(table(read_lines(args.out)) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
