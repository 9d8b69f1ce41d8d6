"""Runs the prompt's worked examples in the engine: each shown result must be what the tool returns."""

import json
import math
import re
from decimal import Decimal
from typing import Any

import pytest

from physment_mcp.scene import Scene
from physment_mcp.serving.examples import EXAMPLES, PromptExample, shown
from physment_mcp.session import Session
from physment_mcp.tools.calls import call_async
from scenes import Permissions, PublicObject
from tests.builders.bench import public_pack

OPEN = Permissions(geom_type=True, geom_density=True, body_mass=True, geom_size=True, geom_radius=True, body_pos=True)
SLOPE = math.atan2(3, 4)
WORLDS = (
    '<body name="object_1" pos="0 0 5"><joint type="free"/><geom type="sphere" size="0.1"/></body>',
    '<body name="object_1"><joint type="slide" axis="1 0 0"/><geom type="box" size="0.1 0.1 0.1" mass="2.5"/></body>',
    f"""
    <body name="object_1" pos="{0.1 * math.sin(SLOPE)} 0 {0.1 * math.cos(SLOPE)}">
      <joint type="free"/><geom type="sphere" size="0.1" mass="1" solref="0.01 1"/>
    </body>
    <geom type="plane" size="50 50 0.1" euler="0 {math.degrees(SLOPE)} 0"/>""",
)
"""The world of each example, in their order."""


def session(world: str) -> Session:
    option = '<option timestep="0.005" integrator="RK4" cone="elliptic" impratio="10" gravity="0 0 -9.81"/>'
    thing = PublicObject(object_id="object_1", name="thing", permissions=OPEN)
    return Session(Scene(public_pack((thing,)), f"<mujoco>{option}<worldbody>{world}</worldbody></mujoco>"))


def unlike(shown: Any, returned: Any, path: str = "") -> list[str]:
    """Return the differences between a shown and a returned result, at the digits shown."""
    if isinstance(shown, dict) and isinstance(returned, dict):
        left: dict[str, Any] = shown  # pyright: ignore[reportUnknownVariableType] - JSON
        right: dict[str, Any] = returned  # pyright: ignore[reportUnknownVariableType] - JSON
        if list(left) != list(right):
            return [f"{path}: {list(left)} is not {list(right)}"]
        return [found for name in left for found in unlike(left[name], right[name], f"{path}.{name}")]
    if isinstance(shown, list) and isinstance(returned, list):
        pairs = zip(shown, returned, strict=True)  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON
        return [found for index, (a, b) in enumerate(pairs) for found in unlike(a, b, f"{path}[{index}]")]
    if isinstance(shown, Decimal):
        exponent = shown.as_tuple().exponent
        assert isinstance(exponent, int)
        tolerance = 0.5 * 10.0**exponent if shown else 1e-9
        return [] if abs(float(shown) - returned) <= tolerance else [f"{path}: {shown} is not {returned}"]
    return [] if shown == returned else [f"{path}: {shown} is not {returned}"]


@pytest.mark.parametrize(("example", "world"), list(zip(EXAMPLES, WORLDS, strict=True)), ids=["ball", "box", "ramp"])
async def test_every_return_shown_is_true(example: PromptExample, world: str) -> None:
    lab = session(world)
    played = [call for turn in example.turns for call in turn.calls]
    assert [call.tool for call in played if not call.returned] == ["answer"] == [played[-1].tool]
    for call in played:
        result = json.loads((await call_async(lab, call.tool, call.arguments)).model_dump_json())
        if call.returned:
            assert unlike(json.loads(call.returned, parse_float=Decimal), result, call.tool) == []


@pytest.mark.parametrize("example", EXAMPLES)
def test_the_calls_of_an_example_are_written_in_the_protocol_of_the_prompt(example: PromptExample) -> None:
    in_text = shown(example, as_json=True)
    written = re.findall(r"```json\n(.*)\n```", in_text)
    assert [[(call["tool"], call["parameters"]) for call in json.loads(calls)] for calls in written] == [
        [(call.tool, call.arguments) for call in turn.calls] for turn in example.turns
    ]
    assert "Calls:" not in in_text
    assert "```" not in shown(example, as_json=False)


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_calculation_in_the_reasoning_is_right(example: PromptExample) -> None:
    """Checks each `a / b = c`, `2 · a / b = c` and `√(a² + b²) = c`, to the digits shown."""
    checked = 0
    for written, result in re.findall(
        r"(√\([^)]*\)|[\d.]+(?: [·/] [\d.]+)+) = ([\d.]+\d)", shown(example, as_json=False)
    ):
        spoken = written.replace("·", "*").replace("²", "**2").replace("√", "math.sqrt")
        value = eval(spoken, {"math": math})
        places = len(result.partition(".")[2])
        assert abs(value - float(result)) <= 0.5 * 10**-places + 1e-12, f"{written} = {value}, not {result}"
        checked += 1
    assert checked


def test_a_wrong_digit_is_caught() -> None:
    shown = json.loads('{"sim_time":0.5,"velocity":[0.0,-4.905]}', parse_float=Decimal)
    assert unlike(shown, {"sim_time": 0.5, "velocity": [0.0, -4.9054]}) == []
    assert unlike(shown, {"sim_time": 0.5, "velocity": [0.0, -4.9056]})
    assert unlike(shown, {"sim_time": 0.5, "velocity": [0.001, -4.905]})
    assert unlike(shown, {"sim_time": 0.5})
