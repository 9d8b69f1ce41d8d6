"""Writes the page of the audit against published checklists, and checks that all evidence it names exists.

python -m tests.harness.audit
"""

import ast
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, TypeAdapter

from tests.builders.paths import DOCS, ROOT

PAGE = DOCS / "reference" / "audit.md"


class Row(BaseModel):
    """An item of a checklist."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    item: str
    asks: str
    """The requirement, paraphrased."""
    status: Literal["met", "partly", "not met", "does not apply"]
    evidence: tuple[str, ...] = ()
    """Tests as `path::function`, pages as paths, commands as they are typed."""
    note: str = ""
    """A description of the missing or different part; needed unless the item is met."""


CHECKLISTS = TypeAdapter(dict[Literal["abc", "betterbench", "benchjack"], tuple[Row, ...]]).validate_python(
    tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
)
"""Checklist → its rows."""
_HEAD = """\
# Audit against published checklists

Made by `python -m tests.harness.audit` from `tests/harness/audit.toml`; do not edit. The command and a test refuse a
row whose test, page or command does not exist. The statuses are the project's own judgement. The items are
paraphrased: read the sources before you rely on a row.
"""
_ABC = """\
Zhu et al. 2025, *Establishing Best Practices for Building Rigorous Agentic Benchmarks*,
[arXiv 2507.02825](https://arxiv.org/abs/2507.02825): task validity (T), outcome validity (O) and reporting (R). The
items follow the list in the authors' repository, which has another numbering; T, O and R are the paper's. The list has
no first item for end-to-end tests, so O.f.1 is missing here."""
_BETTERBENCH = """\
Reuel et al. 2024, *BetterBench: Assessing AI Benchmarks, Uncovering Issues, and Establishing Best Practices*,
[arXiv 2411.12990](https://arxiv.org/abs/2411.12990). The paper counts 46 criteria over the life of a benchmark. We know
them from transcriptions by other projects, which list 47, and none for the fifth stage, retirement. Which of these are
exactly the 46 could not be established, so all are here."""
_BENCHJACK = """\
Wang et al. 2026, *Do Androids Dream of Breaking the Game? Systematically Auditing AI Agent Benchmarks with BenchJack*,
[arXiv 2605.12673](https://arxiv.org/abs/2605.12673). The classes and their numbers follow the authors' repository.
“Met” means that the flaw is absent."""
_SECTIONS = (
    ("Agentic Benchmark Checklist", CHECKLISTS["abc"], _ABC),
    ("BetterBench", CHECKLISTS["betterbench"], _BETTERBENCH),
    ("BenchJack's classes of flaws", CHECKLISTS["benchjack"], _BENCHJACK),
)


def faults(row: Row) -> list[str]:
    """Return the faults in the evidence of a row, as sentences; empty if there are none."""
    found = [f"{row.item}, {row.asks}: {one} does not exist" for one in row.evidence if not _exists(one)]
    if row.status == "met" and not row.evidence:
        found.append(f"{row.item}, {row.asks}: met without evidence")
    if row.status != "met" and not row.note:
        found.append(f"{row.item}, {row.asks}: {row.status} without a reason")
    return found


def _exists(evidence: str) -> bool:
    if evidence.startswith("physment-eval "):
        command = re.compile(rf'add_parser\(\s*"{re.escape(evidence.split()[1])}"')
        sources = (ROOT / "evaluator" / "commands").glob("*.py")
        return any(command.search(file.read_text(encoding="utf-8")) for file in sources)
    if evidence.startswith("python -m "):
        module = ROOT / evidence.split()[2].replace(".", "/")
        return module.with_suffix(".py").is_file() or (module / "__main__.py").is_file()
    path, _, function = evidence.partition("::")
    file = ROOT / path
    return file.is_file() and (not function or function in _functions(file))


def _functions(file: Path) -> set[str]:
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}


def page() -> str:
    """The page, from the rows."""
    parts = [_HEAD]
    for title, rows, source in _SECTIONS:
        counts = Counter(row.status for row in rows)
        said = ", ".join(f"{count} {status}" for status, count in counts.items())
        parts.append(f"## {title}\n\n{source}\n\n{len(rows)} rows: {said}.\n\n{_table(rows)}")
    return "\n".join(parts)


def _table(rows: Sequence[Row]) -> str:
    lines = ["| item | asks for | status | shown by |", "|---|---|---|---|"]
    for row in rows:
        shown = "<br>".join((*map(_shown, row.evidence), *([row.note] if row.note else [])))
        lines.append(f"| {row.item} | {row.asks} | {row.status} | {shown} |")
    return "\n".join(lines) + "\n"


def _shown(evidence: str) -> str:
    if not evidence.startswith("docs/"):
        return f"`{evidence}`"
    return f"[{Path(evidence).stem}](../{evidence.removeprefix('docs/')})"


def main() -> int:
    """Write the page; returns 1 without writing if evidence is missing."""
    found = [fault for _, rows, _ in _SECTIONS for row in rows for fault in faults(row)]
    if found:
        print(*found, sep="\n", file=sys.stderr)
        return 1
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
