"""Generated documents match the code, and links between documents have a target."""

import json
import re
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from evaluator.markdown import markdown_table
from evaluator.records import Episode, GradeRecord, Record, RunRecord
from evaluator.scores.comparison import Comparison
from evaluator.scores.metrics import RunSummary
from physment_mcp.serving.server import published_tools
from scenes import Pack, list_packs
from tests.builders.paths import DOCS


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
        ("run-summary", RunSummary),
        ("comparison", Comparison),
    ],
)
def test_the_schemas_of_results_are_current(name: str, record: type[Record], update_goldens: bool) -> None:
    """The files of a run folder, and what `physment-eval compare --json` prints: records that other programs read."""
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


def test_every_pack_fits_the_published_schema() -> None:
    schema = json.loads((DOCS / "reference" / "scene-pack.schema.json").read_text(encoding="utf-8"))
    validator = Draft202012Validator(schema)
    for files in list_packs():
        validator.validate(json.loads(files.json.read_text(encoding="utf-8")))  # pyright: ignore[reportUnknownMemberType] - partly typed


def test_links_between_documents_have_a_target() -> None:
    broken = [
        f"{page.name} → {target}"
        for page in [DOCS.parent / "README.md", *DOCS.rglob("*.md")]
        for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8"))
        if not target.startswith(("http:", "https:")) and not (page.parent / target).exists()
    ]
    assert broken == []
