"""Worked examples for the opening prompt: short episodes in other scenes.

A test plays them in the engine and compares every result with the example, to the digits shown.
"""

import json
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class ExampleCall:
    """A call of an example."""

    tool: str
    arguments: dict[str, Any]
    returned: str
    """The result as JSON with rounded numbers; empty for the answer."""


@dataclass(frozen=True, slots=True)
class ExampleTurn:
    """An iteration of an example."""

    reasoning: str
    calls: tuple[ExampleCall, ...]


@dataclass(frozen=True, slots=True)
class PromptExample:
    """A worked episode, from the task to the answer."""

    title: str
    task: str
    turns: tuple[ExampleTurn, ...]


def _answer(value: float) -> ExampleCall:
    return ExampleCall("answer", {"answer": value}, "")


EXAMPLES = (
    PromptExample(
        "A dropped ball",
        "with which acceleration does object_1, let go at rest, fall?",
        (
            ExampleTurn(
                "time must pass before a change of velocity exists. I let 0.5 s pass and read the velocity.",
                (
                    ExampleCall(
                        "step",
                        {"duration": 0.5},
                        '{"sim_time":0.5,"steps":100,"lab_time_left":3599.5,"calls_left":null,"results":null}',
                    ),
                    ExampleCall(
                        "get_velocity",
                        {"object_id": "object_1"},
                        '{"sim_time":0.5,"velocity":[0.0,0.0,-4.905],"angular_velocity":null}',
                    ),
                ),
            ),
            ExampleTurn(
                "it started at rest, so a = 4.905 / 0.5 = 9.81 m/s² downward. I check with the last time step.",
                (
                    ExampleCall(
                        "get_acceleration", {"object_id": "object_1"}, '{"sim_time":0.5,"x":0.0,"y":0.0,"z":-9.81}'
                    ),
                ),
            ),
            ExampleTurn("both agree.", (_answer(9.81),)),
        ),
    ),
    PromptExample(
        "A pushed box",
        "what is the mass of object_1, which glides without friction?",
        (
            ExampleTurn(
                "a known force and the acceleration it causes give the mass.",
                (
                    ExampleCall(
                        "apply_force",
                        {"object_id": "object_1", "force_vector": [6, 0, 0]},
                        '{"sim_time":0.0,"status":"force set","object_id":"object_1","force":[6.0,0.0,0.0]}',
                    ),
                    ExampleCall(
                        "step",
                        {"duration": 0.1},
                        '{"sim_time":0.1,"steps":20,"lab_time_left":3599.9,"calls_left":null,"results":null}',
                    ),
                    ExampleCall(
                        "get_acceleration", {"object_id": "object_1"}, '{"sim_time":0.1,"x":2.4,"y":0.0,"z":0.0}'
                    ),
                ),
            ),
            ExampleTurn("m = F / a = 6 / 2.4 = 2.50 kg.", (_answer(2.5),)),
        ),
    ),
    PromptExample(
        "A sphere on a ramp",
        "does object_1 roll down the ramp without slipping (1) or does it slip (2)? Its radius is 0.1 m.",
        (
            ExampleTurn(
                "rolling means that speed and spin agree: v = ω R. If E and L are computed for one mass, ω = 2 E / L.",
                (
                    ExampleCall(
                        "step",
                        {"duration": 0.5},
                        '{"sim_time":0.5,"steps":100,"lab_time_left":3599.5,"calls_left":null,"results":null}',
                    ),
                    ExampleCall(
                        "get_velocity",
                        {"object_id": "object_1"},
                        '{"sim_time":0.5,"velocity":[1.681,0.0,-1.261],"angular_velocity":null}',
                    ),
                    ExampleCall(
                        "get_rotational_energy",
                        {"object_id": "object_1", "mass": 1},
                        '{"sim_time":0.5,"rotational_energy":0.8844}',
                    ),
                    ExampleCall(
                        "get_angular_momentum",
                        {"object_id": "object_1", "mass": 1},
                        '{"sim_time":0.5,"angular_momentum":{"x":0.0,"y":0.08412,"z":0.0}}',
                    ),
                ),
            ),
            ExampleTurn(
                "ω = 2 E / L = 2 · 0.8844 / 0.08412 = 21.03 rad/s, so ω R = 21.03 · 0.1 = 2.103 m/s. The speed is"
                " v = √(1.681² + 1.261²) = 2.101 m/s. They agree.",
                (_answer(1),),
            ),
        ),
    ),
)


def shown(example: PromptExample, *, as_json: bool) -> str:
    """Format an example for the prompt.

    Args:
        example: The example.
        as_json: Whether calls are written as the JSON list that the text protocol demands.
    """
    parts = [f"## {example.title}", f"Task: {example.task}"]
    for turn in example.turns:
        written = f"```json\n{_json_list(turn.calls)}\n```" if as_json else _named(turn.calls)
        parts.append(f"Reasoning: {turn.reasoning}\n{'' if as_json else 'Calls: '}{written}")
        returns = [call for call in turn.calls if call.returned]
        if returns and as_json:
            lines = [f"{number}. {_one(call)} -> {call.returned}" for number, call in enumerate(returns, start=1)]
            parts.append("Returns:\n" + "\n".join(lines))
        elif returns:
            parts[-1] += "\nReturns: " + "; ".join(call.returned for call in returns)
    return "\n\n".join(parts)


def _json_list(calls: tuple[ExampleCall, ...]) -> str:
    return json.dumps([{"tool": call.tool, "parameters": call.arguments} for call in calls])


def _named(calls: tuple[ExampleCall, ...]) -> str:
    return "; ".join(_one(call) for call in calls)


def _one(call: ExampleCall) -> str:
    return f"{call.tool}({', '.join(f'{name}={json.dumps(value)}' for name, value in call.arguments.items())})"
