"""Tests that generated documents match the code, and that links between documents have a target."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from pydantic import BaseModel, TypeAdapter

from evaluator.records.episode import Episode, GradeRecord, Record
from evaluator.records.evidence import EvidenceRecord
from evaluator.records.run import RunRecord
from evaluator.report.export import markdown_table
from evaluator.scores.comparison import Comparison
from evaluator.scores.metrics import RunSummary
from evaluator.study.submission import Submission
from physment_mcp.serving.server import published_tools
from scenes import Erratum, Instruments, LabLimits, Pack, Permissions, default_folder, list_packs
from scenes.answer_spec import AnswerSpec
from scenes.pack import Metadata
from tests.builders.paths import DOCS, ROOT


def tools_page() -> str:
    """The reference page of the tools, generated from their published schemas."""
    lines = [
        "# The 26 tools",
        "",
        "Made from the published schemas by `pytest tests/test_docs.py --update-goldens`; do not edit.",
        "",
        "SI units, world frame, z up; vectors are [x, y, z], quaternions [w, x, y, z]. Every result carries `sim_time`."
        " A refused call returns one sentence that says why, and changes nothing.",
    ]
    for number, tool in enumerate(published_tools(), start=1):
        hints = tool.annotations
        assert hints is not None
        kind = "reads only" if hints.read_only_hint else "destructive" if hints.destructive_hint else "acts"
        lines += ["", f"## {number}. `{tool.name}`", "", f"{tool.description} *({kind})*", ""]
        lines += _table("argument", tool.input_schema)
        assert tool.output_schema is not None
        lines += _table("result", tool.output_schema)
    return "\n".join(lines).rstrip() + "\n"


def _table(title: str, schema: dict[str, Any]) -> list[str]:
    fields = schema.get("properties", {})
    if not fields:
        return ["No arguments.", ""]
    required = set(schema.get("required", []))
    rows: list[tuple[str, str, str]] = []
    for name, field in fields.items():
        default = "" if name in required else f", default {json.dumps(field.get('default'))}"
        rows.append((f"`{name}`", f"{_form(field)}{default}", field.get("description", "")))
    return [markdown_table((title, "form", "meaning"), rows), ""]


def _form(field: dict[str, Any]) -> str:
    if "anyOf" in field:
        return " or ".join(_form(option) for option in field["anyOf"])
    if "enum" in field:
        return " or ".join(map(str, field["enum"]))
    if "$ref" in field:
        return "{x, y, z}"
    if field.get("type") == "array":
        size = field.get("minItems") if field.get("minItems") == field.get("maxItems") else None
        return f"list of {size} × {_form(field['items'])}" if size else f"list of {_form(field['items'])}"
    bounds = [
        f"{sign} {field[key]:g}"
        for key, sign in (
            ("minimum", "≥"),
            ("exclusiveMinimum", ">"),
            ("maximum", "≤"),
            ("exclusiveMaximum", "<"),
        )
        if key in field and abs(field[key]) < 1e6
    ]
    return " ".join([str(field.get("type", "any")), ", ".join(bounds)]).strip()


def test_the_reference_page_of_the_tools_is_current(update_goldens: bool) -> None:
    page = DOCS / "reference" / "tools.md"
    if update_goldens:
        page.write_text(tools_page(), encoding="utf-8")
    assert page.read_text(encoding="utf-8") == tools_page()


def test_the_schema_of_a_pack_is_current(update_goldens: bool) -> None:
    """Editors validate a pack with this schema; `physment-eval lint` checks more."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$comment": "Made from scenes/pack.py by `pytest tests/test_docs.py --update-goldens`; do not edit.",
        **Pack.model_json_schema(),
    }
    text = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    file = DOCS / "reference" / "scene-pack.schema.json"
    if update_goldens:
        file.write_text(text, encoding="utf-8")
    assert file.read_text(encoding="utf-8") == text


@pytest.mark.parametrize(
    ("name", "record"),
    [
        ("run", RunRecord),
        ("episode", Episode),
        ("grade", GradeRecord),
        ("evidence", EvidenceRecord),
        ("run-summary", RunSummary),
        ("comparison", Comparison),
        ("submission", Submission),
    ],
)
def test_the_schemas_of_results_are_current(name: str, record: type[Record], update_goldens: bool) -> None:
    """Other programs read the files of a run folder, the output of `compare --json` and the file of `submit`."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$comment": "Made from the code by `pytest tests/test_docs.py --update-goldens`; do not edit.",
        **record.model_json_schema(mode="serialization"),
    }
    text = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    file = DOCS / "reference" / f"{name}.schema.json"
    if update_goldens:
        file.write_text(text, encoding="utf-8")
    assert file.read_text(encoding="utf-8") == text


def test_the_schema_of_errata_is_current(update_goldens: bool) -> None:
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$comment": "Made from the code by `pytest tests/test_docs.py --update-goldens`; do not edit.",
        "title": "Errata",
        **TypeAdapter(tuple[Erratum, ...]).json_schema(),
    }
    text = json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
    file = DOCS / "reference" / "errata.schema.json"
    if update_goldens:
        file.write_text(text, encoding="utf-8")
    assert file.read_text(encoding="utf-8") == text
    Draft202012Validator(schema).validate(json.loads((default_folder() / "errata.json").read_text(encoding="utf-8")))


@pytest.mark.parametrize("part", [Erratum, Pack, AnswerSpec, Metadata, Permissions, LabLimits, Instruments])
def test_the_page_of_the_format_names_every_field(part: type[BaseModel]) -> None:
    page = (DOCS / "reference" / "scene-format.md").read_text(encoding="utf-8")
    code = " ".join(re.findall(r"`[^`]*`", page))
    assert [name for name in part.model_fields if not re.search(rf"\b{name}\b", code)] == []


def test_every_pack_fits_the_published_schema() -> None:
    schema = json.loads((DOCS / "reference" / "scene-pack.schema.json").read_text(encoding="utf-8"))
    validator = Draft202012Validator(schema)
    for files in list_packs():
        validator.validate(json.loads(files.json.read_text(encoding="utf-8")))  # pyright: ignore[reportUnknownMemberType] - partly typed


def links(page: Path) -> list[tuple[Path, str]]:
    """Return the files that a page links to or embeds, each with its anchor; web addresses are omitted."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    found = [link or source for link, source in re.findall(r"\]\(([^)\s]+)\)|(?:src|srcset)=\"([^\"]+)\"", text)]
    parts = [link.partition("#") for link in found if not re.match(r"\w+:", link)]
    return [((page.parent / target).resolve() if target else page, anchor) for target, _, anchor in parts]


def anchors(page: Path) -> set[str]:
    """Return the link targets in a page: its headings, as GitHub names them, and explicit anchors."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    slugs = {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}
    return slugs | set(re.findall(r'<a id="([^"]+)">', text))


PAGES = [*sorted(ROOT.glob("*.md")), *sorted(DOCS.rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_the_links_of_a_page_lead_to_a_file_and_a_place_in_it(page: Path) -> None:
    broken = [
        f"{target}#{anchor}"
        for target, anchor in links(page)
        if not target.exists() or (anchor and anchor not in anchors(target))
    ]
    assert broken == []


def test_a_reader_reaches_every_page_from_the_index() -> None:
    reached, ahead = set[Path](), [DOCS / "index.md"]
    while ahead:
        page = ahead.pop()
        if page not in reached:
            reached.add(page)
            ahead += [target for target, _ in links(page) if target.suffix == ".md" and target.is_relative_to(DOCS)]
    assert sorted(set(DOCS.rglob("*.md")) - reached) == []


def test_every_decision_has_a_status_with_a_date() -> None:
    status = re.compile(
        r"# \d+\. .+\n\n\*\*Status\.\*\* (?:Accepted|Superseded by \[.+?\]\(.+?\)), \d{4}-\d\d-\d\d[.;]"
    )
    pages = (DOCS / "decisions").glob("0*.md")
    assert [page.name for page in pages if not status.match(page.read_text(encoding="utf-8"))] == []


def test_the_readme_and_the_index_lead_to_every_page_but_decisions_and_scenes() -> None:
    """The index must link every published schema, and every page except those of scenes and decisions."""
    scenes = set((DOCS / "reference" / "scenes").glob("*.md"))
    assert {target for target, _ in links(DOCS / "reference" / "scenes.md")} >= scenes
    listed = {target for target, _ in links(DOCS / "index.md")}
    pages = {page for kind in ("*.md", "*.schema.json") for page in DOCS.rglob(kind)}
    unlisted = pages - listed - scenes - {DOCS / "index.md"}
    assert {page for page in unlisted if page.parent != DOCS / "decisions"} == set()
    assert DOCS / "index.md" in {target for target, _ in links(ROOT / "README.md")}
    assert {target for target, _ in links(DOCS / "decisions" / "README.md")} >= set(DOCS.glob("decisions/0*.md"))
