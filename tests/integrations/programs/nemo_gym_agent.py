"""Plays rows of a dataset on the resources server with a model over HTTP, in the environment of NeMo Gym.

nemo_gym_agent.py MODEL DATASET    prints a line of JSON for each row
"""

import json
import sys
import urllib.request
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

from fastapi.testclient import TestClient
from nemo_gym.base_resources_server import BaseResourcesServerConfig
from nemo_gym.server_utils import ServerClient
from physment_nemo_gym.app import PhysmentResourcesServer


def next_message(model: str, messages: list[dict[str, Any]], tools: list[dict[str, Any]]) -> dict[str, Any]:
    """The model's next message."""
    functions = [
        {"type": "function", "function": {name: tool[name] for name in ("name", "description", "parameters")}}
        for tool in tools
    ]
    body = {"model": "scripted", "messages": messages, "tools": functions}
    request = urllib.request.Request(f"{model}/v1/chat/completions", json.dumps(body).encode())
    with urllib.request.urlopen(request) as reply:
        return json.loads(reply.read())["choices"][0]["message"]


def play(client: TestClient, model: str, row: dict[str, Any]) -> dict[str, Any]:
    """Play a row as `simple_agent` does: open a session, ask and call until the model or budget ends, then verify."""
    client.cookies.clear()
    assert client.post("/seed_session", json=row).status_code == 200
    asked, output = row["responses_create_params"], []
    messages: list[dict[str, Any]] = list(asked["input"])
    for _ in range(row["verifier_metadata"]["budget"]):
        message = next_message(model, messages, asked["tools"])
        if not message.get("tool_calls"):
            break
        call = message["tool_calls"][0]
        function = call["function"]
        text = client.post(f"/{function['name']}", json=json.loads(function["arguments"])).text
        messages += [message, {"role": "tool", "tool_call_id": call["id"], "content": text}]
        output.append({"type": "function_call", "call_id": call["id"], **function})
        output.append({"type": "function_call_output", "call_id": call["id"], "output": text})
    response = {"id": "r", "created_at": 0, "model": "scripted", "object": "response", "output": output}
    response |= {"parallel_tool_calls": False, "tool_choice": "auto", "tools": []}
    found = client.post("/verify", json=row | {"response": response}).json()
    return {
        "pair": row["verifier_metadata"],
        **{name: found[name] for name in ("reward", "outcome", "graded", "calls")},
    }


def main(model: str, dataset: str) -> None:
    """Play all rows on one server."""
    config = BaseResourcesServerConfig(host="127.0.0.1", port=1, entrypoint="app.py", name="physment")
    server = PhysmentResourcesServer(config=config, server_client=MagicMock(spec=ServerClient))
    with TestClient(server.setup_webserver()) as client:
        for line in Path(dataset).read_text(encoding="utf-8").splitlines():
            print(json.dumps(play(client, model, json.loads(line))), flush=True)


main(*sys.argv[1:])
