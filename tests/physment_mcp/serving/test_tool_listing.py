"""Tests of the text that lists the tools: every tool with all its arguments and results, their types and units."""

import re
from typing import Any

import pytest

from physment_mcp.scene import load_scene
from physment_mcp.serving.prompt_blocks import tool_listing
from physment_mcp.serving.prompts import CallProtocol, PromptOptions, opening_prompt
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.base import Tool


def test_every_tool_argument_and_result_is_listed() -> None:
    entries = re.split(r"^- ", tool_listing(TOOLS), flags=re.MULTILINE)[1:]
    assert len(entries) == len(TOOLS) == 26
    for tool, entry in zip(TOOLS, entries, strict=True):
        signature = entry.partition("`: ")[0]
        assert signature.startswith(f"`{tool.name}(")
        assert all(f"{name}: " in signature for name in tool.input_schema().get("properties", {}))
        results = set(tool.output_schema().get("properties", {})) - {"sim_time", "results"}
        assert all(f"`{name}: " in entry for name in results)


def test_types_units_and_defaults_are_told() -> None:
    listing = tool_listing(TOOLS)
    assert "- `step(duration: number)`" in listing
    assert "`duration`: How long to simulate [s]" in listing
    assert "in_world_frame: boolean = true" in listing
    assert "`position: [number × 3]` Origin of the object's frame, world [m]." in listing


@pytest.mark.parametrize("tool", TOOLS, ids=lambda tool: tool.name)
def test_the_listed_result_of_a_tool_is_the_shape_of_its_result_schema(tool: Tool[Any]) -> None:
    """Every leaf of a published schema is in the listing, so no result has the type `any`."""
    listing = tool_listing([tool])
    assert not re.search(r"\bany\b(?=[`\]},]| or )", listing)
    schema = tool.output_schema()
    for name, field in schema.get("properties", {}).items():
        if name not in {"sim_time", "results"}:
            shape = schema["$defs"][field["$ref"].rpartition("/")[2]] if "$ref" in field else field
            parts = shape.get("properties", {})
            expected = "{" + ", ".join(f"{part}: {parts[part]['type']}" for part in parts) + "}" if parts else ""
            assert f"`{name}: {expected}" in listing


@pytest.mark.parametrize("name", ["torque", "momentum", "angular_momentum", "center_of_mass"])
def test_a_vector_by_components_is_listed_with_its_components(name: str) -> None:
    assert f"`{name}: {{x: number, y: number, z: number}}" in tool_listing(TOOLS)


def test_the_listing_stands_in_the_prompt_of_the_text_protocol_alone() -> None:
    session = Session(load_scene(7))
    assert tool_listing(TOOLS) in opening_prompt(session, PromptOptions(protocol=CallProtocol.TEXT))
    native = opening_prompt(session)
    assert "- `step(" not in native
    assert "say in a sentence or two why you make them" in native
