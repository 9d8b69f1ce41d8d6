"""The MCP server of one episode: tools, prompt, resources, instructions. Refusals become error results.

Depends on MCP; contains no physics and no file access.
"""

import functools
import logging
import time
from contextlib import nullcontext
from typing import Any

import mcp_types as types
from mcp import MCPError
from mcp.server import ServerRequestContext
from mcp.server.caching import CacheHint
from mcp.server.lowlevel import Server
from pydantic_core import to_json

from physment_mcp.contract.names import GONE, VIEW, VIEW_URI
from physment_mcp.errors import EpisodeGone, RefusedCall, SceneError, quoted
from physment_mcp.serving.prompts import IDLE_INSTRUCTIONS, CallProtocol, Prompting, PromptOptions, opening_prompt
from physment_mcp.serving.resources import (
    APP_URI,
    FRESH_MS,
    ICON,
    MAX_URI,
    SHOWING,
    app_page,
    app_resources,
    listed_resources,
    listed_templates,
    read,
    shows_apps,
    view_page,
    with_app,
)
from physment_mcp.serving.slot import FULL, EpisodeSlot
from physment_mcp.serving.views import SHOWING_TOOLS, frame_with, recorded, view_with
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS, Tool
from physment_mcp.tools.calls import MAX_NAME, call_async, tools_of
from physment_mcp.version import __version__

logger = logging.getLogger(__name__)

_PROMPT = "scene"
_REPORT_S = 0.04
"""Shortest time between two progress notifications of a call [s]."""
_SAME_FOR_ALL = CacheHint(ttl_ms=FRESH_MS, scope="public")


def build_server(slot: EpisodeSlot) -> Server[Any]:
    """Create an MCP server for the episode in a slot; it can be connected to any transport."""
    service = _Service(slot)
    return Server(
        "physment-mcp",
        version=__version__,
        title="PhysMent laboratory",
        description="A physics laboratory: find quantities by experiment in a MuJoCo scene.",
        icons=[ICON],
        instructions=_instructions(slot),
        cache_hints={
            "tools/list": _SAME_FOR_ALL,
            "prompts/list": _SAME_FOR_ALL,
            "resources/list": _SAME_FOR_ALL,
            "resources/templates/list": _SAME_FOR_ALL,
            "server/discover": CacheHint(),
        },
        get_tool_input_schema=lambda name: _input_schemas(tools_of(slot.session)).get(name),
        on_list_tools=service.list_tools,
        on_call_tool=service.call_tool,
        on_list_prompts=service.list_prompts,
        on_get_prompt=service.get_prompt,
        on_list_resources=service.list_resources,
        on_list_resource_templates=service.list_resource_templates,
        on_read_resource=service.read_resource,
        on_completion=service.complete,
    )


def _instructions(slot: EpisodeSlot) -> str:
    if slot.gone is not None:
        return slot.gone
    return IDLE_INSTRUCTIONS if slot.session is None else opening_prompt(slot.session)


@functools.cache
def published_tools(tools: tuple[Tool[Any], ...] = TOOLS) -> tuple[types.Tool, ...]:
    """Return the 26 tools as MCP publishes them, in a fixed order.

    Args:
        tools: The tools of an episode; by default those of scenes that ask for no law.
    """
    return tuple(
        types.Tool(
            name=tool.name,
            title=tool.title,
            description=tool.description,
            input_schema=tool.input_schema(),
            output_schema=tool.output_schema(),
            annotations=types.ToolAnnotations(
                title=tool.title,
                read_only_hint=tool.reads_only,
                destructive_hint=tool.destructive,
                idempotent_hint=tool.reads_only or tool.idempotent,
                open_world_hint=False,
            ),
        )
        for tool in tools
    )


@functools.cache
def _input_schemas(tools: tuple[Tool[Any], ...]) -> dict[str, dict[str, Any]]:
    return {tool.name: tool.input_schema for tool in published_tools(tools)}


class _Service:
    """The request handlers of one server."""

    def __init__(self, slot: EpisodeSlot) -> None:
        self._slot = slot

    def _shows_app(self, ctx: ServerRequestContext[Any]) -> bool:
        return self._slot.offers_app and shows_apps(ctx.session.client_capabilities)

    async def list_tools(
        self, ctx: ServerRequestContext[Any], _params: types.PaginatedRequestParams | None
    ) -> types.ListToolsResult:
        published = published_tools(tools_of(self._slot.session))
        if self._shows_app(ctx):
            tools = with_app(published)
            return types.ListToolsResult(tools=tools, ttl_ms=FRESH_MS, cache_scope="private")
        return types.ListToolsResult(tools=list(published))

    async def call_tool(
        self, ctx: ServerRequestContext[Any], params: types.CallToolRequestParams
    ) -> types.CallToolResult:
        async with self._slot.turns.exclusive:
            log, session = self._slot.log, self._slot.session
            if session is None or session.ended:
                return await self._call(ctx, params)
            viewed = params.name in SHOWING and self._shows_app(ctx)
            with recorded(session, params.name, params.arguments or {}) if viewed else nullcontext(()) as states:
                started_at = time.monotonic()
                try:
                    result = await self._call(ctx, params)
                except BaseException:
                    log.add(params, None, started_at)
                    raise
                log.add(params, result, started_at)
            if not viewed or result.is_error:
                return result
            view = await view_with(session, self._slot.visibility, states, log.readings())
            return result if view is None else result.model_copy(update={"meta": {VIEW: view}})

    async def _call(self, ctx: ServerRequestContext[Any], params: types.CallToolRequestParams) -> types.CallToolResult:
        give_way, reported_at = self._slot.turns.giving_way(), -_REPORT_S

        async def report(done: float, total: float) -> float | None:
            nonlocal reported_at
            if time.monotonic() - reported_at >= _REPORT_S:
                reported_at = time.monotonic()
                await ctx.session.report_progress(done, total)
            return await give_way()

        try:
            session, arguments = self._slot.session or self._slot.open_session(), params.arguments or {}
            only_answer = FULL if self._slot.log.full else ""
            result = await call_async(session, params.name, arguments, report, only_answer)
        except EpisodeGone as gone:
            return _error(str(gone), {GONE: True})
        except RefusedCall as refusal:
            return _error(str(refusal))
        except Exception as crash:  # an error in our code must not end the episode
            # The traceback may name hidden things, so it is not logged at the default level.
            logger.error("%s failed: %s", params.name[:MAX_NAME], type(crash).__name__)  # noqa: TRY400
            logger.debug("traceback", exc_info=True)
            return _error(
                f"{params.name[:MAX_NAME]} failed inside the laboratory and was rolled back; try something else"
            )
        written = result.model_dump(mode="json")
        content: list[types.ContentBlock] = [types.TextContent(type="text", text=to_json(written).decode())]
        if self._slot.frames is not None and params.name in SHOWING_TOOLS:
            content += await frame_with(self._slot.frames)
        return types.CallToolResult(content=content, structured_content=written)

    async def list_prompts(
        self, _ctx: ServerRequestContext[Any], _params: types.PaginatedRequestParams | None
    ) -> types.ListPromptsResult:
        arguments = [
            types.PromptArgument(
                name="scene_id",
                title="Scene",
                description="Which scene to open, by its number; needed unless one is open.",
                # Clients ask the person for required arguments: this is how a scene is chosen after an idle start.
                required=self._slot.reopen is not None,
            ),
            types.PromptArgument(
                name="prompting", title="Examples", description=f"How many: {', '.join(Prompting)}.", required=False
            ),
            types.PromptArgument(
                name="protocol",
                title="Protocol",
                description=f"How calls are written: {', '.join(CallProtocol)}.",
                required=False,
            ),
            types.PromptArgument(
                name="budget", title="Budget", description="Number of iterations to announce.", required=False
            ),
        ]
        prompt = types.Prompt(
            name=_PROMPT,
            title="Scene",
            description="The task of a scene and all you need for it.",
            arguments=arguments,
            icons=[ICON],
        )
        return types.ListPromptsResult(prompts=[prompt])

    async def get_prompt(
        self, _ctx: ServerRequestContext[Any], params: types.GetPromptRequestParams
    ) -> types.GetPromptResult:
        if params.name != _PROMPT:
            raise _bad_request(f"there is no prompt {quoted(params.name)}; the prompt is {_PROMPT}")
        arguments = params.arguments or {}
        options = _prompt_options(arguments)
        async with self._slot.turns.exclusive:
            session = self._session_for(arguments.get("scene_id"))
            text = opening_prompt(session, options)
        message = types.PromptMessage(role="user", content=types.TextContent(type="text", text=text))
        return types.GetPromptResult(description=session.scene.public.name, messages=[message])

    def _session_for(self, scene_id: str | None) -> Session:
        """Return the open episode. On a server without a fixed scene, a `scene_id` opens a new episode."""
        slot = self._slot
        if slot.gone is not None:
            raise _bad_request(slot.gone)
        if slot.reopen is None or (scene_id is None and slot.session is not None):
            session = slot.open_session()
            if scene_id is not None and scene_id != str(session.scene.public.scene_id):
                raise _bad_request(
                    f"scene {session.scene.public.scene_id} is open in this episode and cannot be changed"
                )
            return session
        if scene_id is None or not _is_count(scene_id):
            raise _bad_request("scene_id must be the number of a scene, such as 7")
        try:
            session = slot.reopen(int(scene_id))
            slot.enter(session)
        except SceneError as error:
            logger.warning("scene %s was asked for: %s", scene_id, error)
            raise _bad_request(error.for_client) from error
        return session

    async def list_resources(
        self, ctx: ServerRequestContext[Any], _params: types.PaginatedRequestParams | None
    ) -> types.ListResourcesResult:
        if self._shows_app(ctx):
            resources = [*listed_resources(), *app_resources()]
            return types.ListResourcesResult(resources=resources, ttl_ms=FRESH_MS, cache_scope="private")
        return types.ListResourcesResult(resources=listed_resources())

    async def list_resource_templates(
        self, _ctx: ServerRequestContext[Any], _params: types.PaginatedRequestParams | None
    ) -> types.ListResourceTemplatesResult:
        return types.ListResourceTemplatesResult(resource_templates=listed_templates())

    async def read_resource(
        self, ctx: ServerRequestContext[Any], params: types.ReadResourceRequestParams
    ) -> types.ReadResourceResult:
        uri, shows_app = str(params.uri), self._shows_app(ctx)
        if shows_app and uri == APP_URI:
            return app_page()
        async with self._slot.turns.exclusive:
            if shows_app and uri == VIEW_URI:
                session = self._slot.session
                read_so_far = self._slot.log.readings()
                found = None if session is None else await view_with(session, self._slot.visibility, (), read_so_far)
                return view_page(found)
            try:
                return read(self._slot, uri)
            except LookupError as error:
                raise MCPError(types.INVALID_PARAMS, str(error), {"uri": uri[:MAX_URI]}) from None

    async def complete(
        self, _ctx: ServerRequestContext[Any], params: types.CompleteRequestParams
    ) -> types.CompleteResult:
        choices = {
            "scene_id": [str(scene_id) for scene_id in self._slot.scene_ids],
            "prompting": list(Prompting),
            "protocol": list(CallProtocol),
            "budget": ["5", "10", "15", "20"],
        }.get(params.argument.name, [])
        matching = [str(choice) for choice in choices if str(choice).startswith(params.argument.value)]
        return types.CompleteResult(
            completion=types.Completion(values=matching[:100], total=len(matching), has_more=len(matching) > 100)
        )


def _prompt_options(arguments: dict[str, str]) -> PromptOptions:
    try:
        prompting = Prompting(arguments.get("prompting") or Prompting.ZERO_SHOT)
        protocol = CallProtocol(arguments.get("protocol") or CallProtocol.NATIVE)
    except ValueError as error:
        raise _bad_request(
            f"{str(error)[:120]}; prompting is one of {', '.join(Prompting)}, protocol one of {', '.join(CallProtocol)}"
        ) from None
    budget = arguments.get("budget")
    if budget is not None and not (_is_count(budget) and int(budget) > 0):
        raise _bad_request("budget must be a whole number above 0")
    return PromptOptions(prompting, protocol, None if budget is None else int(budget))


def _is_count(text: str) -> bool:
    # int() refuses text of more than 4300 digits.
    return text.isdecimal() and len(text) < 10


def _error(sentence: str, meta: dict[str, Any] | None = None) -> types.CallToolResult:
    return types.CallToolResult(is_error=True, content=[types.TextContent(type="text", text=sentence)], _meta=meta)


def _bad_request(sentence: str) -> MCPError:
    return MCPError(types.INVALID_PARAMS, sentence)
