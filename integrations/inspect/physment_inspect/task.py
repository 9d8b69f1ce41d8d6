# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownParameterType=false, reportUnknownArgumentType=false, reportUntypedFunctionDecorator=false
"""The suite as a task of Inspect AI: `inspect eval physment_inspect/physment --model … -T split=test -T budget=20`.

Inspect provides the model, its limits and its log. The loop, the budget, the answer and the grade are those of
`physment-eval`, so that an episode gets the same result. A turn of the model is an iteration.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

from inspect_ai import Task, task
from inspect_ai.dataset import Sample
from inspect_ai.model import (
    ChatMessageTool,
    ChatMessageUser,
    Model,
    ModelOutput,
    get_model,
)
from inspect_ai.scorer import Score, Scorer, Target, mean, scorer, stderr
from inspect_ai.solver import Generate, Solver, TaskState, solver
from inspect_ai.tool import ToolInfo, ToolParams
from inspect_ai.util import LimitExceededError

from evaluator import (
    AgentError,
    Briefing,
    Episode,
    EpisodeKey,
    Exchange,
    Feedback,
    InfrastructureError,
    Reply,
    ToolCall,
    ToolDescription,
    Usage,
    feedback_text,
    grade,
    play,
    select,
)
from physment_inspect.log import score_of
from physment_mcp import __version__
from scenes import find_pack, read_pack, reference_of

EPISODE = "physment_episode"
"""Key of the episode record in the store of a sample."""


@task
def physment(
    scenes: str | int | list[str | int] | None = None,
    seeds: str | int | list[str | int] | None = None,
    budget: int = 20,
    prompting: str = "zero-shot",
    server: str = "stdio",
    split: str | None = None,
) -> Task:
    """The suite, with native tool calls.

    Args:
        scenes: Ids, ranges, rungs and categories, as for `physment-eval --scenes`; by default all but open worlds.
        seeds: Variants, as for `physment-eval --seeds`; by default 0.
        budget: Iterations of an episode.
        prompting: `zero-shot`, `one-shot-cot` or `few-shot-cot`.
        server: As for `physment-eval --server`: `stdio`, the URL of a host, or a command.
        split: Name of a split, from which `scenes` and `seeds` select; by default all its scenes and its first twenty
            seeds are played.

    Raises:
        UsageError: A part is malformed or selects nothing.
    """
    label, packs, numbers = select(split, _selection(scenes), _selection(seeds))
    keys = [
        EpisodeKey(scene=files.scene_id, seed=seed, agent="inspect", budget=budget, prompting=prompting)
        for files in packs
        for seed in numbers
    ]
    return Task(
        dataset=[_sample(key) for key in keys],
        solver=experimenter(server),
        scorer=laboratory_grade(),
        turn_limit=budget,
        version=__version__,
        metadata={"budget": budget, "prompting": prompting} | ({"split": label} if label else {}),
    )


def _selection(value: str | int | list[str | int] | None) -> str | None:
    """Return a selection as text. Inspect's command line converts parts of it to numbers and lists."""
    if value is None:
        return None
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def _sample(key: EpisodeKey) -> Sample:
    """Create a sample for an episode, without its answer. The laboratory writes its opening prompt."""
    pack = read_pack(find_pack(key.scene))
    return Sample(
        id=f"scene{reference_of(key.scene)}-seed{key.seed}",
        input=f"Scene {key.scene}: {pack.metadata.scene_name}",
        metadata={"key": key.model_dump(), "category": pack.category, "problem_type": pack.metadata.problem_type},
    )


@solver
def experimenter(server: str) -> Solver:
    """Plays a sample's episode with the model under evaluation.

    Args:
        server: As for `physment-eval --server`.
    """

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        del generate  # it would run the calls by itself
        model = get_model()
        key = EpisodeKey.model_validate(state.metadata["key"])
        agent = _InspectAgent(model, state)
        episode = await play(agent, key.scene, seed=key.seed, budget=key.budget, prompting=key.prompting, server=server)
        state.store.set(EPISODE, episode.model_dump(mode="json"))
        state.completed = True
        if agent.limit is not None:
            raise agent.limit
        return state

    return solve


@dataclass(slots=True)
class _InspectAgent:
    """The model of Inspect as an agent. The conversation is stored in the sample."""

    model: Model
    state: TaskState
    limit: LimitExceededError | None = None
    """The limit of Inspect that ended the episode, which Inspect must record."""

    @property
    def name(self) -> str:
        return f"inspect:{self.model}"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_Player":
        del key
        self.state.messages = [ChatMessageUser(content=briefing.prompt)]
        return _Player(self, [_tool_info(tool) for tool in briefing.tools])


@dataclass(slots=True)
class _Player:
    agent: _InspectAgent
    tools: list[ToolInfo]
    last: ModelOutput = field(default_factory=ModelOutput)

    async def act(self, feedback: Feedback | None) -> Reply:
        state = self.agent.state
        if feedback is not None:
            state.messages += _returns(self.last, feedback.exchanges)
            # Each result is a separate message. All other feedback is worded as in the text protocol.
            rest = feedback_text(Feedback((), feedback.note, feedback.remaining))
            state.messages.append(ChatMessageUser(content=rest))
        try:
            self.last = await self.agent.model.generate(state.messages, tools=self.tools)
        except LimitExceededError as limit:
            self.agent.limit = limit
            raise AgentError(f"a limit of Inspect was reached: {limit}") from limit
        except Exception as error:
            raise InfrastructureError(f"{self.agent.model} did not reply: {error!r}") from error
        state.output = self.last
        state.messages.append(self.last.message)
        return _reply(self.last)


def _returns(output: ModelOutput, exchanges: Sequence[Exchange]) -> list[ChatMessageTool]:
    """Return the result message of each call of a turn, even if the call was not run."""
    returns: list[ChatMessageTool] = []
    for number, call in enumerate(output.message.tool_calls or ()):
        exchange = exchanges[number] if number < len(exchanges) else None
        text = "Not run." if exchange is None else exchange.text
        if exchange is not None and not exchange.returned:
            text = f"Not run. {text}".strip()
        returns.append(ChatMessageTool(content=text, tool_call_id=call.id, function=call.function))
    return returns


def _reply(output: ModelOutput) -> Reply:
    """Convert a turn of the model to a reply of the agent loop.

    Raises:
        AgentError: The model refuses or cannot continue.
    """
    if output.stop_reason == "content_filter":
        raise AgentError(f"the model or its content filter refused: {output.completion[:500]}")
    if output.stop_reason == "model_length":
        raise AgentError("the conversation no longer fits the model's context window")
    calls = output.message.tool_calls or []
    problems = [
        f"the arguments of {call.function} are not a JSON object: {call.parse_error}"
        for call in calls
        if call.parse_error
    ]
    if output.stop_reason == "max_tokens":
        problems.append("it was cut off at the limit of output tokens")
    return Reply(
        reasoning=_said(output),
        calls=() if problems else tuple(ToolCall(tool=call.function, arguments=call.arguments) for call in calls),
        malformed=problems[0] if problems else "",
        usage=_usage(output),
    )


def _said(output: ModelOutput) -> str:
    content = output.message.content
    parts = (
        [content]
        if isinstance(content, str)
        else [getattr(part, "reasoning", None) or getattr(part, "text", "") for part in content]
    )
    return "\n\n".join(part for part in parts if part.strip())


def _usage(output: ModelOutput) -> Usage | None:
    used = output.usage
    if used is None:
        return None
    cached = used.input_tokens_cache_read or 0
    # Inspect counts tokens from the cache separately; the input tokens of our records include them.
    return Usage(
        input_tokens=used.input_tokens + cached,
        output_tokens=used.output_tokens,
        cached_tokens=cached,
        cost_usd=getattr(used, "total_cost", None),
    )


def _tool_info(tool: ToolDescription) -> ToolInfo:
    """Convert a tool to Inspect's form, whose schemas omit some limits, such as lengths of lists."""
    return ToolInfo(
        name=tool.name,
        description=tool.description,
        parameters=ToolParams.model_validate(json.loads(json.dumps(tool.input_schema))),
    )


@scorer(metrics={"strict": [mean(), stderr()], "normalised": [mean(), stderr()], "graded": [mean(), stderr()]})
def laboratory_grade() -> Scorer:
    """Scorer with the verdicts of `physment-eval grade`. Only this function reads the answer key."""

    async def score(state: TaskState, target: Target) -> Score:
        del target
        episode = Episode.model_validate(state.store.get(EPISODE))
        return score_of(episode, grade(episode).grade)

    return score
