# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false, reportUnknownVariableType=false, reportUnknownMemberType=false
# pyright: reportUnknownParameterType=false, reportUnknownArgumentType=false, reportUntypedFunctionDecorator=false
"""The suite as a task of Inspect AI: `inspect eval evaluator/inspect_task.py --model … -T scenes=7-20 -T budget=20`.

Inspect brings the model, its limits and its log; the loop, the budget, the answer and the grade are ours, so that an
episode counts here what it counts in `physment-eval`. A turn of the model is an iteration.
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

from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import own_version
from evaluator.episode.connect import connect
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing, Feedback, Reply, ToolDescription
from evaluator.errors import AgentError, InfrastructureError
from evaluator.protocols.text import feedback_text
from evaluator.records import Episode, EpisodeKey, Exchange, ToolCall, Usage, Verdict, Versions
from evaluator.study.provenance import server_record
from evaluator.study.selection import parse_numbers, parse_scenes
from scenes import find_pack, pack_hash, read_pack

EPISODE = "physment_episode"
"""Key in the store of a sample under which the record of its episode is kept."""


@task
def physment(
    scenes: str | int | list[str | int] | None = None,
    seeds: str | int | list[str | int] = "0",
    budget: int = 20,
    prompting: str = "zero-shot",
    server: str = "stdio",
) -> Task:
    """The suite, with native tool calls.

    Args:
        scenes: Ids, ranges and categories, as of `physment-eval --scenes`; all of them if None.
        seeds: Variants, as of `physment-eval --seeds`.
        budget: Iterations of an episode.
        prompting: `zero-shot`, `one-shot-cot` or `few-shot-cot`.
        server: As of `physment-eval --server`: `stdio`, the URL of a host, or a command.

    Raises:
        UsageError: A part is malformed or selects nothing.
    """
    keys = [
        EpisodeKey(scene=files.scene_id, seed=seed, agent="inspect", budget=budget, prompting=prompting)
        for files in parse_scenes(None if scenes is None else _selection(scenes), None)
        for seed in parse_numbers(_selection(seeds), "seeds", 0)
    ]
    return Task(
        dataset=[_sample(key) for key in keys],
        solver=experimenter(server),
        scorer=laboratory_grade(),
        turn_limit=budget,
        version=own_version(),
        metadata={"budget": budget, "prompting": prompting},
    )


def _selection(value: str | int | list[str | int]) -> str:
    """A selection as it was typed: Inspect's command line makes numbers and lists of what looks like them."""
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def _sample(key: EpisodeKey) -> Sample:
    """An episode to come; its opening prompt is the laboratory's, and its answer stands nowhere."""
    pack = read_pack(find_pack(key.scene))
    return Sample(
        id=f"scene{key.scene}-seed{key.seed}",
        input=f"Scene {key.scene}: {pack.metadata.scene_name}",
        metadata={"key": key.model_dump(), "category": pack.category, "problem_type": pack.metadata.problem_type},
    )


@solver
def experimenter(server: str) -> Solver:
    """Plays a sample's episode with the model under evaluation.

    Args:
        server: As of `physment-eval --server`.
    """

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        del generate  # it would run the calls itself
        model = get_model()
        key = EpisodeKey.model_validate(state.metadata["key"]).model_copy(update={"agent": f"inspect:{model}"})
        agent = _InspectAgent(model, state)
        async with connect(server, None) as laboratory, laboratory.open(key.scene, key.seed) as client:
            protocol = (await server_record(client, server)).protocol
            versions = Versions(physment=own_version(), protocol=protocol, pack=pack_hash(find_pack(key.scene)))
            episode = await play_episode(agent, client, key, versions)
        state.store.set(EPISODE, episode.model_dump(mode="json"))
        state.completed = True
        if agent.limit is not None:
            raise agent.limit
        return state

    return solve


@dataclass(slots=True)
class _InspectAgent:
    """Inspect's model as an agent of ours; the conversation is the sample's."""

    model: Model
    state: TaskState
    limit: LimitExceededError | None = None
    """The limit of Inspect's that ended the episode; it is for Inspect to write down."""

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
            # Returns go into their own messages; the rest is worded as in the text protocol.
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
    """What each call of a turn is answered, also where it was not run."""
    returns: list[ChatMessageTool] = []
    for number, call in enumerate(output.message.tool_calls or ()):
        one = exchanges[number] if number < len(exchanges) else None
        text = "Not run." if one is None else one.text if one.returned else f"Not run. {one.text}".strip()
        returns.append(ChatMessageTool(content=text, tool_call_id=call.id, function=call.function))
    return returns


def _reply(output: ModelOutput) -> Reply:
    """A turn of the model, as the loop reads it.

    Raises:
        AgentError: The model will not or cannot go on.
    """
    if output.stop_reason == "content_filter":
        raise AgentError(f"the model or its content filter refused: {output.completion[:500]}")
    if output.stop_reason == "model_length":
        raise AgentError("the conversation no longer fits the model's context window")
    calls = output.message.tool_calls or []
    problems = [
        f"the arguments of {one.function} are not a JSON object: {one.parse_error}" for one in calls if one.parse_error
    ]
    if output.stop_reason == "max_tokens":
        problems.append("it was cut off at the limit of output tokens")
    return Reply(
        reasoning=_said(output),
        calls=() if problems else tuple(ToolCall(tool=one.function, arguments=one.arguments) for one in calls),
        malformed=problems[0] if problems else "",
        usage=_usage(output),
    )


def _said(output: ModelOutput) -> str:
    content = output.message.content
    parts = (
        [content]
        if isinstance(content, str)
        else [getattr(one, "reasoning", None) or getattr(one, "text", "") for one in content]
    )
    return "\n\n".join(part for part in parts if part.strip())


def _usage(output: ModelOutput) -> Usage | None:
    used = output.usage
    if used is None:
        return None
    cached = used.input_tokens_cache_read or 0
    # Inspect counts tokens read from the cache apart from the rest of the input; our records count them in.
    return Usage(
        input_tokens=used.input_tokens + cached,
        output_tokens=used.output_tokens,
        cached_tokens=cached,
        cost_usd=getattr(used, "total_cost", None),
    )


def _tool_info(tool: ToolDescription) -> ToolInfo:
    """A tool as Inspect tells models of it; what its schemas have no place for, as lengths of lists, is left out."""
    return ToolInfo(
        name=tool.name,
        description=tool.description,
        parameters=ToolParams.model_validate(json.loads(json.dumps(tool.input_schema))),
    )


@scorer(metrics={"strict": [mean(), stderr()], "normalised": [mean(), stderr()], "graded": [mean(), stderr()]})
def laboratory_grade() -> Scorer:
    """The verdicts of `physment-eval grade`; the answer key is read here and nowhere before."""
    keys = KeyRing()

    async def score(state: TaskState, target: Target) -> Score:
        del target
        episode = Episode.model_validate(state.store.get(EPISODE))
        found = grade_episode(episode, keys.key(episode.key.scene, episode.key.seed))
        return Score(
            value={
                "strict": float(found.strict is Verdict.CORRECT),
                "normalised": float(found.normalised is Verdict.CORRECT),
                "graded": found.graded or 0.0,
            },
            answer=None if episode.answer is None else json.dumps(episode.answer),
            explanation=found.reason,
            metadata={"outcome": episode.outcome.value, "iterations": len(episode.turns)},
        )

    return score
