"""How tools are written into a request."""

from collections.abc import Sequence
from dataclasses import dataclass

from pydantic_ai.models import ModelRequestParameters
from pydantic_ai.settings import ModelSettings
from pydantic_ai.tools import ToolDefinition

from evaluator.agents.models.presets import Dialect
from evaluator.episode.player import ToolDescription


@dataclass(frozen=True, slots=True)
class Offer:
    """The tools of a request, made once for each conversation."""

    parameters: ModelRequestParameters
    settings: ModelSettings
    """Added to the settings of every request."""


NOTHING = Offer(ModelRequestParameters(), ModelSettings())
"""No tools, for models that write calls as text."""


def offer(dialect: Dialect, tools: Sequence[ToolDescription]) -> Offer:
    """The tools, with their schemas as the server published them.

    For chat completions they are written into the body here: the client would process all 26 schemas again for each
    request, which takes 2 to 3 ms, nearly half of the processor time of a turn. For other providers the client writes
    them, in the subset of JSON Schema that the provider accepts.
    """
    if dialect in {Dialect.OPENAI, Dialect.OPENROUTER}:
        functions = [
            {"name": tool.name, "description": tool.description, "parameters": dict(tool.input_schema)}
            for tool in tools
        ]
        body = {"tools": [{"type": "function", "function": function} for function in functions]}
        return Offer(ModelRequestParameters(), ModelSettings(extra_body=body))
    definitions = [
        # With `strict`, a provider may narrow the schemas; the loop checks calls against the published ones.
        ToolDefinition(
            name=tool.name, parameters_json_schema=dict(tool.input_schema), description=tool.description, strict=False
        )
        for tool in tools
    ]
    return Offer(ModelRequestParameters(function_tools=definitions), ModelSettings())
