"""The configuration of a run, built from the command line, a study file or Python, and the participants that it names.

A provider's client library is imported when it is needed.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from evaluator.agents.attackers.strategies import AttackerAgent
from evaluator.agents.baselines import BlindAgent, OracleOnceAgent, RandomAgent
from evaluator.agents.custom import load_agent
from evaluator.agents.external.agent import ExternalAgent, parse_external
from evaluator.agents.models.choice import Lanes, Options, Patience, parse_model
from evaluator.agents.presentation import Change, presented
from evaluator.agents.recorded import load_recorded
from evaluator.agents.reference import BatchAgent, ConstantAgent, ReferenceAgent, load_script
from evaluator.agents.stopping import with_stopping
from evaluator.agents.takers import TakerAgent
from evaluator.episode.loop import AgentParticipant, Participant
from evaluator.episode.player import Agent
from evaluator.errors import UsageError
from evaluator.records.run import Plan, SeedKey, SeedOf, seed_as_recorded
from evaluator.study.meter import Limits
from evaluator.study.shards import WHOLE, Shard
from scenes import PackFiles


@dataclass(frozen=True, slots=True, kw_only=True)
class RunConfig:
    """The configuration of a run. It can be pickled, and creates the same agents on every machine."""

    # Who plays
    agents: tuple[str, ...] = ("reference",)
    """Value of each `--agent`."""
    server: str = "stdio"
    """Value of `--server`."""
    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""
    observations: str = "text"
    """`text`, or `rgb` for results with images."""
    model_options: Options = field(default_factory=Options)
    """Options of all models."""
    base_url: str | None = None
    """Base URL of the models' API, instead of the provider's own."""
    lanes: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → largest number of concurrent requests."""
    patience: Patience = field(default_factory=Patience)
    """Timeouts and number of retries of requests to models."""
    stopping: str = "always"
    """Value of `--stopping`: the policy that advises agents when to answer."""
    presentation: tuple[Change, ...] = ()
    """Changes of the presentation that agents receive; see `evaluator.agents.presentation`."""
    command: tuple[str, ...] = ()
    """Arguments after `--`: the program of an external agent."""
    max_calls: int | None = None
    """Largest number of tool calls of an external agent in an episode."""
    max_wall_s: float = 1800.0
    """Time limit of an external agent for an episode, as wall time [s]."""
    home: Path | None = None
    """Template folder that is copied to the home directory of an external agent."""
    sealed: bool = False
    """Whether the operator declares that an external agent cannot read the packs."""
    users: tuple[str, ...] = ()
    """System users that a sealed agent runs as."""
    seed_key: SeedKey | None = None
    """The key of held-back seeds; None if the seeds are as recorded."""

    # The matrix
    packs: tuple[PackFiles, ...] = ()
    split: str = ""
    """Name and version of the split of scenes and seeds; empty if none was named."""
    budgets: tuple[int, ...] = (20,)
    seeds: tuple[int, ...] = (0,)
    spare_seeds: range = range(0)
    """Seeds that may replace a seed that fails its checks; empty if the operator named the seeds."""
    unproved: bool = False
    """Whether seeds that no certificate covers are played without checking them."""
    epochs: int = 1
    same_seeds: bool = False
    """Whether external agents get the same seeds at each repetition, as other agents do."""
    promptings: tuple[str, ...] = ("zero-shot",)
    protocols: tuple[str, ...] = ("native",)
    adaptive: float | None = None
    """Standard error of the ability at which an adaptive test ends [logits]; None to play the whole matrix."""
    difficulties: Path | None = None
    """`calibration.json` with the difficulties for an adaptive test; None for the one that ships."""
    shard: Shard = WHOLE
    """The part of the matrix that this process plays."""

    # Execution
    limits: Limits = field(default_factory=Limits)
    concurrency: int = 1
    """Number of episodes played at a time."""
    executor: str = "local"
    """`local` or `ray`."""
    workers: int | None = None
    """Number of worker processes; None for the default of `usual_workers`."""
    episode_timeout_s: float | None = 7200.0
    """Time limit of one attempt at an episode, as wall time [s]; None for no limit."""
    out: Path | None = None
    """Run folder, or parent folder of the shards; None for a new folder below `runs`."""
    resume: bool = False
    allow_modified: bool = False
    """Whether to accept records that do not match their seal."""
    dry_run: bool = False
    otel: bool = False
    """Whether to export OpenTelemetry spans."""
    as_json: bool = False
    """Whether to print the summary to stdout as JSON, and everything else to stderr."""

    @property
    def seed_of(self) -> SeedOf:
        """The function that maps the seed in an episode's key to the seed from which its hidden values are sampled."""
        return seed_as_recorded if self.seed_key is None else self.seed_key.seed

    def plan(self, participants: Mapping[str, Participant]) -> Plan:
        """The matrix of the run.

        Args:
            participants: Name → participant.
        """
        programs = tuple(name for name, participant in participants.items() if isinstance(participant, ExternalAgent))
        return Plan(
            scenes=tuple(files.scene_id for files in self.packs),
            agents=tuple(participants),
            budgets=self.budgets,
            seeds=self.seeds,
            epochs=self.epochs,
            promptings=self.promptings,
            protocols=self.protocols,
            observations=self.observations,
            own_seeds=() if self.same_seeds else programs,
            split=self.split,
            presentation=tuple(map(str, self.presentation)),
            held_back=self.seed_key.commitment if self.seed_key else "",
        )


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
