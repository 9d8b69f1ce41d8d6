"""From `--agent model:…` to a participant; the provider's client is loaded here and not before."""

from collections.abc import Mapping

from evaluator.agents.models.choice import Options, parse_model
from evaluator.agents.models.lanes import Lanes, Patience
from evaluator.episode.participant import AgentParticipant
from evaluator.errors import UsageError


def model_participant(
    text: str,
    options: Options | None = None,
    base_url: str | None = None,
    lanes: Lanes | None = None,
    patience: Patience | None = None,
    environ: Mapping[str, str] | None = None,
) -> AgentParticipant:
    """The model that `text` names, ready to play.

    Args:
        text: `model:PRESET` or `model:PROVIDER:NAME`, with or without options.
        options: Options of all models; options in `text` win.
        base_url: Address to ask, instead of the provider's own.
        lanes: Shared by all agents of a run, so that the limit of a provider holds for all of them together.
        patience: How long to wait for a model.
        environ: Environment variables; by default those of the process.

    Raises:
        UsageError: There is no such model, something is missing to ask it, or it does not accept an option.
    """
    choice = parse_model(text, options or Options(), base_url, environ)
    if lacking := choice.missing():
        raise UsageError(f"{text}: {'; '.join(lacking)}; see `physment-eval models`")
    from evaluator.agents.models.agent import ModelAgent  # noqa: PLC0415 - loading the client takes half a second

    agent = ModelAgent(choice, (lanes or Lanes()).of(choice.provider.name), patience or Patience())
    return AgentParticipant(agent, agent.facts(), agent)
