"""Plays sessions of the laboratory with OpenEnv's own harness and a model over HTTP, in the environment of OpenEnv.

openenv_session.py MODEL TURNS FACTORY TASK...    prints a line of JSON for each task; FACTORY and TASK are JSON, too
"""

import json
import sys
import urllib.request
from typing import Any

from openenv.core.harness import HarnessRunLimits, MCPHarnessAdapter, ModelStepResult
from openenv.core.llm_client import LLMResponse, ToolCall
from physment_openenv.session import PhysmentSessionFactory


def main(model: str, turns: str, factory: str, *tasks: str) -> None:
    """Play each task to its end; a task that is a number is the seed of a group, as TRL gives it."""

    def sampled(messages: list[dict[str, Any]], tools: list[Any], sampling: dict[str, Any]) -> ModelStepResult:
        del tools, sampling
        body = json.dumps({"model": "scripted", "messages": messages}).encode()
        request = urllib.request.Request(f"{model}/v1/chat/completions", body)
        with urllib.request.urlopen(request) as reply:
            message = json.loads(reply.read())["choices"][0]["message"]
        calls = [
            ToolCall(id=call["id"], name=call["function"]["name"], args=json.loads(call["function"]["arguments"]))
            for call in message.get("tool_calls") or []
        ]
        return ModelStepResult(LLMResponse(content=message["content"] or "", tool_calls=calls))

    sessions = PhysmentSessionFactory(**json.loads(factory))
    for named in map(json.loads, tasks):
        prompt, seed = ([{"role": "user", "content": ""}], named) if isinstance(named, int) else (named, None)
        session = sessions.create(prompt, seed=seed, episode_id="e")
        try:
            played = MCPHarnessAdapter().run_white_box(sampled, session, HarnessRunLimits(max_turns=int(turns)))
            found = [session.verify(played.messages), session.verify(played.messages)]
            refused = sum(entry.result.error is not None for entry in played.tool_trace)
            facts = {"done": played.done, "calls": len(played.tool_trace), "refused": refused}
            facts |= {"tools": len(session.list_tools()), "rewards": [one.env_reward for one in found]}
            print(json.dumps(facts | {"metrics": found[0].metrics}), flush=True)
        finally:
            session.close()


main(*sys.argv[1:])
