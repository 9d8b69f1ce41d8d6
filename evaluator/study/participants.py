"""Creates the participants that a `RunConfig` names. A provider's client library is imported when it is needed."""

from collections.abc import Callable, Mapping
from pathlib import Path

from evaluator.agents.attackers.strategies import AttackerAgent
from evaluator.agents.baselines import BlindAgent, OracleOnceAgent, RandomAgent
from evaluator.agents.custom import load_agent
from evaluator.agents.external.agent import ExternalAgent
from evaluator.agents.external.command import parse_external
from evaluator.agents.models.choice import Options, parse_model
from evaluator.agents.models.lanes import Lanes, Patience
from evaluator.agents.presentation import presented
from evaluator.agents.recorded import load_recorded
from evaluator.agents.reference import ReferenceAgent
from evaluator.agents.scripted import BatchAgent, ConstantAgent, load_script
from evaluator.agents.stopping import with_stopping
from evaluator.agents.takers import TakerAgent
from evaluator.episode.loop import AgentParticipant, Participant
from evaluator.episode.player import Agent
from evaluator.errors import UsageError
from evaluator.study.run_config import RunConfig


def model_participant(
    text: str,
    options: Options | None = None,
    base_url: str | None = None,
    lanes: Lanes | None = None,
    patience: Patience | None = None,
    environ: Mapping[str, str] | None = None,
) -> AgentParticipant:
    """Create the participant for a language model.

    Args:
        text: `model:PRESET` or `model:PROVIDER:NAME`, with or without options.
        options: Options of all models; options in `text` win.
        base_url: Base URL of the API, instead of the provider's own.
        lanes: Concurrency limits of the providers, shared by all agents of a run.
        patience: Timeouts and number of retries of requests to the model.
        environ: Environment variables; by default those of the process.

    Raises:
        UsageError: The model is unknown, its API key or client library is missing, or it does not accept an option.
    """
    choice = parse_model(text, options or Options(), base_url, environ)
    if lacking := choice.missing():
        raise UsageError(f"{text}: {'; '.join(lacking)}; see `physment-eval models`")
    from evaluator.agents.models.agent import ModelAgent  # noqa: PLC0415 - loading the client takes half a second

    agent = ModelAgent(choice, (lanes or Lanes()).of(choice.provider.name), patience or Patience())
    return AgentParticipant(agent, agent.facts(), agent)


AGENTS = (
    "reference",
    "grammar",
    "random",
    "blind",
    "constant",
    "batch",
    "attacker:sweep|glance|proportional",
    "taker:HANDICAP",
    "model:PRESET",
    "model:PROVIDER:NAME",
    "oracle-once:AGENT",
    "scripted:FILE",
    "replay:DIR",
    "MODULE:CLASS",
    "external -- COMMAND",
)
"""Forms of the values that `--agent` accepts."""
EXTERNAL = "external"
_SPEAK_ORIGINAL = frozenset({"reference", "grammar", "constant", "batch", "attacker", "scripted", "replay", "taker"})
"""Kinds of agents that are programs written for the laboratory's own names and units; see `presented`."""
_PLAIN: Mapping[str, Callable[[Path | None], Agent]] = {
    "reference": ReferenceAgent,
    "grammar": lambda _: _grammar(),
    "random": lambda _: RandomAgent(),
    "blind": lambda _: BlindAgent(),
    "constant": ConstantAgent,
    "batch": BatchAgent,
}
"""Name of each agent without parameters → function that creates it from the folder of scene packs."""


def _grammar() -> Agent:
    from evaluator.agents.grammar import GrammarAgent  # noqa: PLC0415 - loads scipy, which no other agent needs

    return GrammarAgent()


def participants_of(config: RunConfig) -> dict[str, Participant]:
    """Create the participants of a run, by name.

    Raises:
        UsageError: A participant cannot be created, or two have the same name.
    """
    if config.command and EXTERNAL not in config.agents:
        raise UsageError(f"{config.command[0]}: not an option; a command after -- belongs to --agent external")
    lanes = Lanes(config.lanes)
    participants: dict[str, Participant] = {}
    for text in config.agents:
        participant = _external(config) if text == EXTERNAL else _wrapped(config, text, _by_turns(config, text, lanes))
        if participant.name in participants:
            raise UsageError(f"--agent {text}: is given twice")
        participants[participant.name] = participant
    return participants


def _external(config: RunConfig) -> ExternalAgent:
    if config.presentation:
        raise UsageError("--presentation: an external agent speaks with the laboratory itself")
    if config.stopping != "always":
        raise UsageError("--stopping: an external agent drives itself and cannot be told when to answer")
    return parse_external(
        config.command,
        config.server,
        config.scenes_dir,
        vouched=config.sealed,
        max_calls=config.max_calls,
        max_wall_s=config.max_wall_s,
        home=config.home,
        users=config.users,
    )


def _wrapped(config: RunConfig, text: str, participant: AgentParticipant) -> AgentParticipant:
    """Wrap a participant's agent in the stopping policy and the presentation of the run."""
    original = text.removeprefix("oracle-once:").partition(":")[0] in _SPEAK_ORIGINAL
    advised = participant.wrapped(lambda agent: with_stopping(agent, config.stopping))
    return advised.wrapped(lambda agent: presented(agent, config.presentation, speaks_original=original))


def _by_turns(config: RunConfig, text: str, lanes: Lanes) -> AgentParticipant:
    """Create the participant for one value of `--agent` other than an external program.

    Raises:
        UsageError: There is no such agent, or it cannot be made.
    """
    kind, _, rest = text.partition(":")
    match kind, bool(rest):
        case "model", True:
            participant = model_participant(text, config.model_options, config.base_url, lanes, config.patience)
        case "oracle-once", True:
            participant = _by_turns(config, rest, lanes).wrapped(OracleOnceAgent)
        case "attacker", True:
            participant = AgentParticipant(AttackerAgent(rest))
        case "taker", True:
            participant = AgentParticipant(TakerAgent(rest, config.scenes_dir))
        case "scripted", True:
            participant = AgentParticipant(load_script(Path(rest)))
        case "replay", True:
            participant = AgentParticipant(load_recorded(Path(rest)))
        case _, True:
            participant = load_agent(text)
        case _ if kind in _PLAIN:
            participant = AgentParticipant(_PLAIN[kind](config.scenes_dir))
        case _:
            raise UsageError(f"--agent {text}: there is no such agent; the agents are {', '.join(AGENTS)}")
    return participant
