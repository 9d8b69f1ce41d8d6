"""Measures the scenes on several versions of MuJoCo, each in its own environment, and prints a table.

python -m tests.harness.engines.run                          the newest 3.x and the newest 4.x, against the locked one
python -m tests.harness.engines.run 4.1.0 --scenes 7-20      another version, on some scenes
python -m tests.harness.engines.run --certify                also write the certificates of each engine (hours)
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from time import monotonic
from typing import Any

from rich.console import Console

from evaluator.certify.subject import Subject
from evaluator.report.export import markdown_table
from evaluator.study.selection import parse_scenes
from scenes import find_pack
from tests.harness.engines.environments import ROOT, CannotInstall, environment_of

NEWEST = ("3.17.0", "4.0.0")
"""The newest 3.x and 4.x releases at the time of the last update of this list."""
QUARTER = 0.25
"""Largest difference between the keys of two engines, as a share of the tolerance.

The certificate allows the same difference between theory and engine."""

Found = Mapping[str, Any]
"""The output of `measuring` for a scene."""


@dataclass(frozen=True, slots=True)
class Row:
    """The result on one engine."""

    engine: str
    python: str
    scenes: int
    wrong: Mapping[int, str]
    """Scene whose reference answer is wrong → the reason."""
    other_keys: Mapping[int, str]
    """Scene whose key differs from that on the locked engine → the difference."""
    minutes: float

    def cells(self) -> list[str]:
        """The cells of the table row."""
        right = f"{self.scenes - len(self.wrong)} of {self.scenes}"
        return [self.engine, self.python, right, str(len(self.other_keys)), f"{self.minutes:.0f}"]


TITLES = ("MuJoCo", "Python", "references right", "scenes whose key differs", "minutes")


def other_key(subject: Subject, base: Sequence[Any], keys: Sequence[Any]) -> str:
    """Describe the first seed at which the key differs from that on the locked engine; empty if there is none."""
    if len(keys) != len(base):
        return "the engine gives no key"
    for seed, (mine, theirs) in enumerate(zip(base, keys, strict=True)):
        if not subject.agrees(theirs, mine, QUARTER):
            return f"seed {seed}: {theirs} instead of {mine}"
    return ""


def measure(python: str | Path, options: Sequence[str]) -> Iterator[Found]:
    """Yield the results of each scene on the engine of an environment."""
    words = [str(python), "-m", "tests.harness.engines.measuring", *options]
    with subprocess.Popen(words, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            yield json.loads(line)


def row_of(engine: str, found: Sequence[Found], base: Mapping[int, Found], seconds: float) -> Row:
    """Make the row of an engine from its results."""
    others = {one["scene"]: other_key(_subject(one["scene"]), base[one["scene"]]["keys"], one["keys"]) for one in found}
    return Row(
        engine,
        found[0]["python"] if found else "",
        len(found),
        {one["scene"]: one["why"] for one in found if not one["right"]},
        {scene: how for scene, how in others.items() if how},
        seconds / 60,
    )


def _subject(scene: int) -> Subject:
    return Subject.open(find_pack(scene))


def main(argv: Sequence[str]) -> int:
    """Measure and print; returns 0 if, on every engine, all references are right and all keys agree."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("engines", nargs="*", default=NEWEST, metavar="VERSION", help=f"default: {' '.join(NEWEST)}")
    parser.add_argument("--scenes", metavar="SEL", help="such as 7-20 (default: all, open worlds too)")
    parser.add_argument("--seeds", default="5", metavar="N", help="compare the keys of seeds 0 to N-1 (default 5)")
    parser.add_argument("--jobs", default=str(os.cpu_count()), metavar="N", help="processes (default: one per core)")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the environments (default: this one)")
    parser.add_argument("--certify", action="store_true", help="then run `physment-eval verify` in each environment")
    args = parser.parse_args(argv)
    count, console = len(parse_scenes(args.scenes, None)), Console(stderr=True)
    options = ["--seeds", args.seeds, "--jobs", args.jobs, *(["--scenes", args.scenes] if args.scenes else [])]
    rows: list[Row] = []
    base: Mapping[int, Found] = {}
    pythons: dict[str, str | Path] = {version("mujoco"): sys.executable}
    for engine in args.engines:
        try:
            with console.status(f"installing MuJoCo {engine}"):
                pythons[engine] = environment_of(engine, args.python)
        except CannotInstall as error:
            console.print(f"MuJoCo {engine} cannot be installed: {error}", style="red", markup=False, soft_wrap=True)
            return 1
    for engine, python in pythons.items():
        begun, found = monotonic(), list[Found]()
        with console.status(f"MuJoCo {engine}") as status:
            for one in measure(python, options):
                found.append(one)
                status.update(f"MuJoCo {engine}: {len(found)} of {count} scenes")
        base = base or {one["scene"]: one for one in found}
        rows.append(row_of(engine, found, base, monotonic() - begun))
        if args.certify:
            subprocess.run([python, "-m", "evaluator", "verify", "--jobs", args.jobs], cwd=ROOT, check=False)
    for row in rows:
        for what, reasons in (("reference", row.wrong), ("key", row.other_keys)):
            for scene, why in reasons.items():
                line = f"MuJoCo {row.engine}, scene {scene}, {what}: {why}"
                console.print(line, style="red", markup=False, highlight=False, soft_wrap=True)
    sys.stdout.write(markdown_table(TITLES, [row.cells() for row in rows]) + "\n")
    return 1 if any(row.wrong or row.other_keys or row.scenes < count for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
