"""Who plays a run: from what `--agent` and its companions say to contenders, in this process or on another machine."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from evaluator.agents.attackers.agent import AttackerAgent
from evaluator.agents.baselines import BlindAgent, OracleOnceAgent, RandomAgent
from evaluator.agents.custom import load_agent
from evaluator.agents.external.agent import ExternalAgent
from evaluator.agents.external.command import parse_external
from evaluator.agents.recorded import load_recorded
from evaluator.agents.reference import ReferenceAgent
from evaluator.agents.scripted import load_script
from evaluator.agents.stopping import with_stopping
from evaluator.episode.contender import AgentContender, Contender
from evaluator.errors import UsageError
from evaluator.models.choice import Options
from evaluator.models.factory import model_contender
from evaluator.models.lanes import Lanes, Patience
from evaluator.seed_key import SeedKey, SeedOf, seed_as_recorded

AGENTS = (
    "reference",
    "random",
    "blind",
    "attacker:sweep|glance|proportional",
    "model:PRESET",
    "model:PROVIDER:NAME",
    "oracle-once:AGENT",
    "scripted:FILE",
    "replay:DIR",
    "MODULE:CLASS",
    "external -- COMMAND",
)
"""What `--agent` takes."""
EXTERNAL = "external"


@dataclass(frozen=True, slots=True)
class Team:
    """The options that decide who plays. Can be sent to another machine, and makes the same contenders there."""

    agents: tuple[str, ...]
    """Value of each `--agent`."""
    scenes_dir: Path | None = None
    server: str = "stdio"
    observations: str = "text"
    """`text`, or `rgb` for results with pictures."""
    options: Options = field(default_factory=Options)
    """Options of all models."""
    base_url: str | None = None
    lanes: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → most requests at a time."""
    patience: Patience = field(default_factory=Patience)
    stopping: str = "always"
    command: tuple[str, ...] = ()
    """Words after `--`: the program of an external agent."""
    max_calls: int | None = None
    """Most tool calls of an external agent in an episode."""
    max_wall_s: float = 1800.0
    """Most wall time of an external agent for an episode [s]."""
    home: Path | None = None
    """Folder whose content each home of an external agent starts with."""
    sealed: bool = False
    """The operator vouches that an external agent cannot read the packs."""
    users: tuple[str, ...] = ()
    """System users that a sealed agent runs as."""
    seed_key: SeedKey | None = None
    """The key of held-back seeds; None if the seeds are as recorded."""

    @property
    def seed_of(self) -> SeedOf:
        """What turns the seeds of episodes into those that variants are drawn from."""
        return seed_as_recorded if self.seed_key is None else self.seed_key.seed

    def build(self) -> dict[str, Contender]:
        """The contenders by name.

        Raises:
            UsageError: One of them cannot be made, or two have the same name.
        """
        if self.command and EXTERNAL not in self.agents:
            raise UsageError(f"{self.command[0]}: not an option; a command after -- belongs to --agent external")
        lanes = Lanes(self.lanes)
        contenders: dict[str, Contender] = {}
        for text in self.agents:
            contender = self._external() if text == EXTERNAL else self._with_stopping(self._by_turns(text, lanes))
            if contender.name in contenders:
                raise UsageError(f"--agent {text}: is given twice")
            contenders[contender.name] = contender
        return contenders

    def _external(self) -> ExternalAgent:
        if self.stopping != "always":
            raise UsageError("--stopping: an external agent drives itself and cannot be told when to answer")
        return parse_external(
            self.command,
            self.server,
            self.scenes_dir,
            vouched=self.sealed,
            max_calls=self.max_calls,
            max_wall_s=self.max_wall_s,
            home=self.home,
            users=self.users,
        )

    def _with_stopping(self, contender: AgentContender) -> AgentContender:
        return contender.wrapped(lambda agent: with_stopping(agent, self.stopping))

    def _by_turns(self, text: str, lanes: Lanes) -> AgentContender:
        """The contender that one `--agent` names, unless it is a program.

        Raises:
            UsageError: There is no such agent, or it cannot be made.
        """
        kind, _, rest = text.partition(":")
        match kind, bool(rest):
            case "model", True:
                contender = model_contender(text, self.options, self.base_url, lanes, self.patience)
            case "oracle-once", True:
                contender = self._by_turns(rest, lanes).wrapped(OracleOnceAgent)
            case "reference", False:
                contender = AgentContender(ReferenceAgent(self.scenes_dir))
            case "random", False:
                contender = AgentContender(RandomAgent())
            case "blind", False:
                contender = AgentContender(BlindAgent())
            case "attacker", True:
                contender = AgentContender(AttackerAgent(rest))
            case "scripted", True:
                contender = AgentContender(load_script(Path(rest)))
            case "replay", True:
                contender = AgentContender(load_recorded(Path(rest)))
            case _, True:
                contender = load_agent(text)
            case _:
                raise UsageError(f"--agent {text}: there is no such agent; the agents are {', '.join(AGENTS)}")
        return contender
