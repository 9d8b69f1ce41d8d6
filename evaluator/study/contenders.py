"""Who plays a run: from what `--agent` and its companions say to contenders, in this process or on another machine."""

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
from evaluator.models.factory import model_contender
from evaluator.models.lanes import Lanes
from evaluator.study.run_config import RunConfig

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


def contenders_of(config: RunConfig) -> dict[str, Contender]:
    """The contenders by name.

    Raises:
        UsageError: One of them cannot be made, or two have the same name.
    """
    if config.command and EXTERNAL not in config.agents:
        raise UsageError(f"{config.command[0]}: not an option; a command after -- belongs to --agent external")
    lanes = Lanes(config.lanes)
    contenders: dict[str, Contender] = {}
    for text in config.agents:
        contender = _external(config) if text == EXTERNAL else _with_stopping(config, _by_turns(config, text, lanes))
        if contender.name in contenders:
            raise UsageError(f"--agent {text}: is given twice")
        contenders[contender.name] = contender
    return contenders


def _external(config: RunConfig) -> ExternalAgent:
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


def _with_stopping(config: RunConfig, contender: AgentContender) -> AgentContender:
    return contender.wrapped(lambda agent: with_stopping(agent, config.stopping))


def _by_turns(config: RunConfig, text: str, lanes: Lanes) -> AgentContender:
    """The contender that one `--agent` names, unless it is a program.

    Raises:
        UsageError: There is no such agent, or it cannot be made.
    """
    kind, _, rest = text.partition(":")
    match kind, bool(rest):
        case "model", True:
            contender = model_contender(text, config.model_options, config.base_url, lanes, config.patience)
        case "oracle-once", True:
            contender = _by_turns(config, rest, lanes).wrapped(OracleOnceAgent)
        case "reference", False:
            contender = AgentContender(ReferenceAgent(config.scenes_dir))
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
