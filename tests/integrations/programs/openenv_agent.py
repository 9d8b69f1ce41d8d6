"""Plays episodes on an OpenEnv server with a model over HTTP, in the environment of OpenEnv.

openenv_agent.py SERVER MODEL BUDGET VARIANT...    prints a line of JSON for each episode; a variant is JSON, too
"""

import json
import sys
import urllib.request
from typing import Any

from physment_openenv import PhysmentAction, PhysmentEnv


def next_call(model: str, messages: list[dict[str, Any]], tools: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the model's next message, which contains one call."""
    described = [
        {"name": tool["name"], "description": tool["description"], "parameters": tool["input_schema"]} for tool in tools
    ]
    body = {
        "model": "scripted",
        "messages": messages,
        "tools": [{"type": "function", "function": f} for f in described],
    }
    request = urllib.request.Request(f"{model}/v1/chat/completions", json.dumps(body).encode())
    with urllib.request.urlopen(request) as reply:
        return json.loads(reply.read())["choices"][0]["message"]


def play(env: Any, model: str, budget: int, variant: dict[str, Any]) -> dict[str, Any]:
    """Play one episode to its end."""
    seen = env.reset(**variant, budget=budget)
    tools, rewards = seen.observation.tools, [seen.reward]
    messages: list[dict[str, Any]] = [{"role": "user", "content": seen.observation.prompt}]
    while not seen.done:
        message = next_call(model, messages, tools)
        call = message["tool_calls"][0]
        function = call["function"]
        seen = env.step(PhysmentAction(tool=function["name"], arguments=json.loads(function["arguments"])))
        rewards.append(seen.reward)
        messages += [message, {"role": "tool", "tool_call_id": call["id"], "content": seen.observation.text}]
    last = seen.observation
    facts = {"outcome": last.outcome, "verdict": last.verdict, "rewards": rewards, "tools": len(tools)}
    return {"state": env.state().model_dump(), **facts}


def main(server: str, model: str, budget: str, *variants: str) -> None:
    """Play all variants in one session."""
    with PhysmentEnv(base_url=server).sync() as env:
        for variant in variants:
            print(json.dumps(play(env, model, int(budget), json.loads(variant))), flush=True)


main(*sys.argv[1:])
