"""Plays episodes on the environments for TRL with a model over HTTP, in the environment of TRL.

trl_agent.py BACKEND MODEL BUDGET VARIANT...    prints a line of JSON for each episode; a variant is JSON, too

It calls the methods of the environment as the trainer does.
"""

import json
import sys
import urllib.request
from typing import Any

from physment_trl import PhysMent

BACKENDS = {"referee": PhysMent}
if sys.argv[1] == "process":
    from physment_trl.in_process import InProcessPhysMent

    BACKENDS["process"] = InProcessPhysMent


def next_message(model: str, messages: list[dict[str, Any]]) -> dict[str, Any]:
    """The model's next message."""
    body = {"model": "scripted", "messages": messages}
    request = urllib.request.Request(f"{model}/v1/chat/completions", json.dumps(body).encode())
    with urllib.request.urlopen(request) as reply:
        return json.loads(reply.read())["choices"][0]["message"]


def play(env: Any, model: str, variant: dict[str, Any]) -> dict[str, Any]:
    """Play one episode to its end."""
    messages: list[dict[str, Any]] = [{"role": "user", "content": env.reset(**variant)}]
    calls = 0
    while (message := next_message(model, messages)).get("tool_calls"):
        call = message["tool_calls"][0]
        text = getattr(env, call["function"]["name"])(**json.loads(call["function"]["arguments"]))
        messages += [message, {"role": "tool", "tool_call_id": call["id"], "content": text}]
        calls += 1
    return {"reward": env.get_reward(), "calls": calls}


def main(backend: str, model: str, budget: str, *variants: str) -> None:
    """Play all variants in one environment, as TRL reuses it."""
    env = BACKENDS[backend]()
    for variant in variants:
        print(json.dumps(play(env, model, {**json.loads(variant), "budget": int(budget)})), flush=True)


main(*sys.argv[1:])
