"""The chat loop inside the worker: a rollout starts no process, and each call of a tool is one POST to the host.

It is a separate module, because verifiers finds a harness by the name of its package.
"""

import contextlib
import json
from collections.abc import AsyncGenerator
from typing import Any, cast

import aiohttp
import verifiers.v1 as vf
from physment_laboratory import CONNECT_S, READ_S, CallResult, LaboratoryError, request_of, result_of
from physment_referee import ANSWER
from pydantic import Field
from verifiers.v1.clients import ModelContext
from verifiers.v1.configs.harness import HarnessConfig
from verifiers.v1.dialects.chat import message_to_wire
from verifiers.v1.errors import MODEL_TRANSPORT_ERROR_EXIT_CODE
from verifiers.v1.harness import Harness
from verifiers.v1.harnesses.utils.compaction import CONTEXT_OVERFLOW_MARKERS
from verifiers.v1.runtimes import ProgramResult

__all__ = ["PhysmentHarness"]

_TAIL = 2000
"""Most characters of a failed reply that an error quotes."""


class LaboratoryState(vf.State):
    """Data of a rollout's episode, such as address and tokens. Only the harness uses them, not the model."""

    episode_id: str = ""
    owner_token: str = ""
    mcp_url: str = ""
    player_token: str = ""
    prompt: str = ""
    tools: list[dict[str, Any]] = Field(default_factory=list)
    """The tools as the model gets them, in the format of chat completions."""
    answered: bool = False


class PhysmentHarnessConfig(HarnessConfig):
    """`--env.agent.harness.*`."""

    id: str = "physment-harness"


class PhysmentHarness(Harness[PhysmentHarnessConfig]):
    """Plays all rollouts of a worker over one pool of connections."""

    APPENDS_SYSTEM_PROMPT = True
    SUPPORTS_RESUME = True
    EXECUTES_CODE = False
    NEEDS_CONTAINER = False

    def __init__(self, config: PhysmentHarnessConfig) -> None:
        """Store the configuration; the first rollout opens the connections."""
        super().__init__(config)
        self._pool: aiohttp.ClientSession | None = None
        self._playing = 0

    @contextlib.asynccontextmanager
    async def _connections(self) -> AsyncGenerator[aiohttp.ClientSession]:
        """The pool of connections, created at its first use."""
        if self._pool is None:
            self._pool = aiohttp.ClientSession(
                connector=aiohttp.TCPConnector(limit=0), timeout=aiohttp.ClientTimeout(total=None, connect=CONNECT_S)
            )
        self._playing += 1
        try:
            yield self._pool
        finally:
            self._playing -= 1
            if not self._playing:
                pool, self._pool = self._pool, None
                await pool.close()

    async def launch(
        self,
        ctx: ModelContext,
        trace: vf.Trace,
        runtime: vf.Runtime,
        endpoint: str,
        secret: str,
        mcp_urls: dict[str, str],
        data: vf.TaskData,
    ) -> ProgramResult:
        """Ask the model and make its calls, until it replies without a call or a request is refused."""
        del runtime, mcp_urls
        state = cast(LaboratoryState, trace.state)
        system, prompt = self.resolve_prompt(data)
        messages: list[dict[str, Any]] = [{"role": "system", "content": system}] if system else []
        said = [vf.UserMessage(content=prompt)] if isinstance(prompt, str) else prompt or []
        messages += map(message_to_wire, said)
        async with self._connections() as http:
            while True:
                body = {"model": ctx.model, "messages": messages, "tools": state.tools}
                try:
                    message = await _reply(http, endpoint, secret, body)
                except _ModelError as error:
                    return error.result
                messages.append(message)
                if not message.get("tool_calls"):
                    return ProgramResult(0, "", "")
                for call in message["tool_calls"]:
                    text = await _call(http, state, call["function"])
                    messages.append({"role": "tool", "tool_call_id": call["id"], "content": text})


class _ModelError(Exception):
    """The model gave no reply."""

    def __init__(self, result: ProgramResult) -> None:
        super().__init__(result.stderr)
        self.result = result


async def _reply(http: aiohttp.ClientSession, endpoint: str, secret: str, body: dict[str, Any]) -> dict[str, Any]:
    """The model's next message.

    Raises:
        _ModelError: The request failed or was refused, for example because the rollout has ended.
    """
    headers = {"Authorization": f"Bearer {secret}"}
    try:
        async with http.post(f"{endpoint}/chat/completions", json=body, headers=headers) as reply:
            text = await reply.text()
            if reply.status == 200:
                message = json.loads(text)["choices"][0]["message"]
                return {name: value for name, value in message.items() if value is not None}
    except (aiohttp.ClientError, TimeoutError) as error:
        raise _ModelError(ProgramResult(MODEL_TRANSPORT_ERROR_EXIT_CODE, "", repr(error))) from error
    # A full context is a limit, not a failure: the rollout ends with what was said.
    full = reply.status in {400, 413} and any(marker in text.casefold() for marker in CONTEXT_OVERFLOW_MARKERS)
    raise _ModelError(ProgramResult(0 if full else 1, "", text[-_TAIL:]))


async def _call(http: aiohttp.ClientSession, state: LaboratoryState, function: dict[str, str]) -> str:
    """Make a tool call; returns the text of its result for the model.

    Raises:
        LaboratoryError: The host failed; the model is not at fault.
    """
    name = function["name"]
    try:
        arguments = json.loads(function["arguments"] or "{}")
    except ValueError as error:
        return f"the arguments must be a JSON object, and these are no JSON ({error})"
    if not isinstance(arguments, dict):
        return f"the arguments must be a JSON object, not {json.dumps(arguments)[:80]}"
    result = await _called(http, state, name, cast(dict[str, Any], arguments))
    state.answered = state.answered or (name == ANSWER and not result.is_error)
    return result.text


async def _called(
    http: aiohttp.ClientSession, state: LaboratoryState, name: str, arguments: dict[str, Any]
) -> CallResult:
    headers, body = request_of(state.player_token, name, arguments)
    timeout = aiohttp.ClientTimeout(total=None, connect=CONNECT_S, sock_read=READ_S)
    try:
        async with http.post(state.mcp_url, data=body, headers=headers, timeout=timeout) as reply:
            return result_of(reply.status, await reply.read())
    except (aiohttp.ClientError, TimeoutError) as error:
        raise LaboratoryError(f"the host at {state.mcp_url} cannot be reached ({error!r})") from error
