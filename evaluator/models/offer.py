"""How the tools are put into a request."""

from collections.abc import Sequence
from dataclasses import dataclass

from pydantic_ai.models import ModelRequestParameters
from pydantic_ai.settings import ModelSettings
from pydantic_ai.tools import ToolDefinition

from evaluator.episode.player import ToolDescription
from evaluator.models.presets import Dialect


@dataclass(frozen=True, slots=True)
class Offer:
    """The tools of a request; made once for a conversation."""

    parameters: ModelRequestParameters
    settings: ModelSettings
    """On top of those of every request."""


NOTHING = Offer(ModelRequestParameters(), ModelSettings())
"""No tools: calls are written as text."""


def offer(dialect: Dialect, tools: Sequence[ToolDescription]) -> Offer:
    """Tools with their schemas as the server published them.

    With chat completions they go straight into the body: the client would walk through all 26 schemas anew for each
    request, which takes 2 to 3 ms of processor time, nearly half of a turn's. The others' clients write them, in the
    subset of JSON Schema that the provider takes.
    """
    if dialect in {Dialect.OPENAI, Dialect.OPENROUTER}:
        functions = [
            {"name": one.name, "description": one.description, "parameters": dict(one.input_schema)} for one in tools
        ]
        body = {"tools": [{"type": "function", "function": one} for one in functions]}
        return Offer(ModelRequestParameters(), ModelSettings(extra_body=body))
    definitions = [
        # `strict` would let a provider narrow the schemas; the loop checks calls against them as they are.
        ToolDefinition(
            name=one.name, parameters_json_schema=dict(one.input_schema), description=one.description, strict=False
        )
        for one in tools
    ]
    return Offer(ModelRequestParameters(function_tools=definitions), ModelSettings())
