"""Who plays a run: from what `--agent` and its companions say to agents, in this process or on another machine."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from evaluator.agents.baselines import BlindAgent, OracleOnceAgent, RandomAgent
from evaluator.agents.external.agent import ExternalAgent, parse_external
from evaluator.agents.reference import ReferenceAgent
from evaluator.agents.replay import load_replay
from evaluator.agents.scripted import load_script
from evaluator.agents.stopping import StoppingAgent, with_stopping
from evaluator.episode.player import Agent
from evaluator.errors import UsageError
from evaluator.models.choice import Options
from evaluator.models.factory import model_agent
from evaluator.models.lanes import Lanes, Patience
from evaluator.study.attempts import Contender

AGENTS = (
    "reference",
    "random",
    "blind",
    "model:PRESET",
    "model:PROVIDER:NAME",
    "oracle-once:AGENT",
    "scripted:FILE",
    "replay:DIR",
    "external -- COMMAND",
)


@dataclass(frozen=True, slots=True)
class Team:
    """All that decides who plays; builds the same contenders wherever it is sent."""

    agents: tuple[str, ...]
    """What each `--agent` says."""
    scenes_dir: Path | None = None
    server: str = "stdio"
    options: Options = field(default_factory=Options)
    """Of models."""
    base_url: str | None = None
    lanes: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → requests under way."""
    patience: Patience = field(default_factory=Patience)
    stopping: str = "always"
    command: tuple[str, ...] = ()
    """What follows `--`: the program of an external agent."""
    max_calls: int | None = None
    """Tool calls of an external agent."""
    max_wall_s: float = 1800.0
    """Wall time of an external agent [s]."""
    sealed: bool = False
    """The operator vouches that an external agent cannot read the packs."""

    def build(self) -> dict[str, Contender]:
        """The contenders by name.

        Raises:
            UsageError: One cannot be had, or two have one name.
        """
        if self.command and "external" not in self.agents:
            raise UsageError(f"{self.command[0]}: not an option; a command after -- belongs to --agent external")
        lanes = Lanes(self.lanes)
        found: dict[str, Contender] = {}
        for text in self.agents:
            contender = self._contender(text, lanes)
            if contender.name in found:
                raise UsageError(f"--agent {text}: is given twice")
            found[contender.name] = contender
        return found

    def _contender(self, text: str, lanes: Lanes) -> Contender:
        if text != "external":
            return with_stopping(self._agent(text, lanes), self.stopping)
        if self.stopping != "always":
            raise UsageError("--stopping: an external agent drives itself and cannot be told when to answer")
        return parse_external(
            self.command,
            self.server,
            self.scenes_dir,
            vouched=self.sealed,
            max_calls=self.max_calls,
            max_wall_s=self.max_wall_s,
        )

    def _agent(self, text: str, lanes: Lanes) -> Agent:
        makers: dict[tuple[str, bool], Callable[[str], Agent]] = {
            ("reference", False): lambda _: ReferenceAgent(self.scenes_dir),
            ("random", False): lambda _: RandomAgent(),
            ("blind", False): lambda _: BlindAgent(),
            ("oracle-once", True): lambda rest: OracleOnceAgent(self._agent(rest, lanes)),
            ("scripted", True): lambda rest: load_script(Path(rest)),
            ("replay", True): lambda rest: load_replay(Path(rest)),
            ("model", True): lambda _: model_agent(text, self.options, self.base_url, lanes, self.patience),
        }
        kind, _, rest = text.partition(":")
        if (kind, bool(rest)) not in makers:
            raise UsageError(f"--agent {text}: there is no such agent; the agents are {', '.join(AGENTS)}")
        return makers[kind, bool(rest)](rest)


def agent_facts(contender: Contender) -> dict[str, Any]:
    """What of a contender decides results, for `run.json`; holds no key. Empty where the name says it all."""
    while isinstance(contender, StoppingAgent | OracleOnceAgent):
        contender = contender.inner
    if isinstance(contender, ExternalAgent):
        return contender.facts()
    settings = getattr(contender, "settings", None)
    return {} if settings is None else settings()
