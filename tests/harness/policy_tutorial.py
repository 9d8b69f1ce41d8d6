"""Trains the policy of the tutorial and checks that it becomes better than random play.

python -m tests.harness.policy_tutorial
"""

import ast
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.builders.paths import DOCS

PAGE = (DOCS / "tutorials" / "a-policy-that-learns.md").read_text(encoding="utf-8")
UPDATES = 180
"""A quarter of the updates of the page, which is enough for two of the three scenes."""
Shares = dict[int, float]
"""Scene → share of right answers."""


def shares(printed: str, words: str) -> Shares:
    """Parse the line of a text that begins with these words."""
    found = re.search(rf"^{words} (\{{.*\}})$", printed, re.MULTILINE)
    assert found is not None, printed
    return ast.literal_eval(found[1])


def learned(updates: int) -> tuple[Shares, Shares]:
    """Run the program of the page; returns the trained policy's shares, and the 99 % quantile of random play."""
    (program,) = re.findall(r"`learn\.py`:\n\n```python\n(.*?)```", PAGE, flags=re.DOTALL)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "learn.py").write_text(program, encoding="utf-8")
        command = [sys.executable, "learn.py", "--seed", "10", "--updates", str(updates)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return shares(done.stdout, "trained"), shares(done.stdout, "its 99 % quantile")


def main() -> int:
    """Train, and print the shares; returns 0 if the policy is better than random play in scenes 7 and 9."""
    trained, limits = learned(UPDATES)
    sys.stdout.write(f"trained {trained}\n99 % quantile of random play {limits}\n")
    return 0 if all(trained[scene] > limits[scene] for scene in (7, 9)) else 1


if __name__ == "__main__":
    sys.exit(main())
