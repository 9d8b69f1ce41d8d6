"""The tools as text: every tool with all its arguments and results, their types and units."""

import re

from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import CallProtocol, PromptOptions, opening_prompt
from physment_mcp.serving.tool_listing import tool_listing
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS


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


def test_the_listing_stands_in_the_prompt_of_the_text_protocol_alone() -> None:
    session = Session(load_scene(7))
    assert tool_listing(TOOLS) in opening_prompt(session, PromptOptions(protocol=CallProtocol.TEXT))
    native = opening_prompt(session)
    assert "- `step(" not in native
    assert "say in a sentence or two why you make them" in native
