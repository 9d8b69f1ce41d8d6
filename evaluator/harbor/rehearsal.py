"""What a task folder holds of a variant: its prompt, and the calls by which the reference protocol solves it."""

from dataclasses import dataclass
from importlib.metadata import version

from evaluator.agents.external.agent import CALLS_PER_ITERATION, calls_allowed
from evaluator.agents.external.watched import watch_episode
from evaluator.agents.reference import ReferenceAgent
from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import HostLaboratory
from evaluator.episode.loop import play_episode
from evaluator.errors import UsageError
from evaluator.records import EpisodeKey, ToolCall, Verdict, Versions
from evaluator.scores.scoring import grade_record

_BUDGET = 20
"""Iterations from which the number of calls follows, as for external agents."""


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """A variant as it was played once."""

    scene: int
    seed: int
    prompt: str
    """The opening prompt, which gives the number of calls."""
    max_calls: int
    """Tool calls that an agent may make."""
    solution: tuple[ToolCall, ...]
    """The calls of the reference protocol, in order, the last one being its answer."""


async def rehearse(host: HostLaboratory, keys: KeyRing, scene: int, seed: int) -> Rehearsal:
    """Let the reference protocol play a variant, and read the prompt that other agents get.

    Args:
        host: Where.
        keys: Say whether it is right.
        scene: Which scene.
        seed: Which variant of it.

    Raises:
        UsageError: There is no such scene, or the protocol does not solve this variant.
        InfrastructureError: The host failed.
    """
    agent = ReferenceAgent(keys.folder)
    keys.key(scene, seed)  # a scene without a key must be refused before it is played
    key = EpisodeKey(scene=scene, seed=seed, agent=agent.name, budget=_BUDGET)
    async with host.open(scene, seed) as client:
        versions = Versions(physment=version("physment-mcp"), protocol=client.protocol_version, pack="")
        played = await play_episode(agent, client, key, versions, host.toolboxes)
    if grade_record(played, keys).grade.strict is not Verdict.CORRECT:
        raise UsageError(f"the reference protocol does not solve scene {scene} at seed {seed}, so it is no fair task")
    solution = tuple(exchange.call for turn in played.turns for exchange in turn.exchanges)
    max_calls = _most_calls(len(solution), calls_allowed(scene, keys.folder))
    async with watch_episode(host, scene, seed, max_calls) as watched:
        return Rehearsal(scene, seed, await watched.prompt(key), max_calls, solution)


def _most_calls(solution: int, allowed: int | None) -> int:
    """How many calls an agent may make: as an external agent, but never fewer than the solution, in whole hundreds."""
    if allowed is not None:
        return allowed + 1
    return max(CALLS_PER_ITERATION * _BUDGET, -(-solution // 100) * 100)
