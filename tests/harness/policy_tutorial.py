"""Trains the policies of the tutorials and checks that they become better than random play.

python -m tests.harness.policy_tutorial
"""

import ast
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.builders.paths import DOCS

POLICY, NETWORK = (
    (DOCS / "tutorials" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("a-policy-that-learns", "a-network-that-predicts")
)
UPDATES = 180
"""A quarter of the updates that the page `a-policy-that-learns` makes: enough to learn two of its three scenes."""
Shares = dict[int, float]
"""Scene → share of right answers."""


def shares(printed: str, words: str) -> Shares:
    """Parse the line of a text that begins with these words."""
    found = re.search(rf"^{words} (\{{.*\}})$", printed, re.MULTILINE)
    assert found is not None, printed
    return ast.literal_eval(found[1])


def learned(page: str, updates: int, *options: str) -> tuple[Shares, Shares]:
    """Run the program of a page; returns the trained policy's shares, and the 99 % quantile of random play."""
    ((name, program),) = re.findall(r"`(\w+\.py)`:\n\n```python\n(.*?)```", page, flags=re.DOTALL)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / name).write_text(program, encoding="utf-8")
        command = [sys.executable, name, "--seed", "10", "--updates", str(updates), *options]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return shares(done.stdout, "trained"), shares(done.stdout, "its 99 % quantile")


def main() -> int:
    """Run the programs of both tutorials, one with fewer updates; returns 0 if both are better than random play."""
    right = True
    for page, updates, scenes in ((POLICY, UPDATES, (7, 9)), (NETWORK, 600, (7, 9, 10, 11, 12, 64))):
        trained, limits = learned(page, updates)
        sys.stdout.write(f"trained {trained}\n99 % quantile of random play {limits}\n")
        right &= all(trained[scene] > limits[scene] for scene in scenes)
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main())
