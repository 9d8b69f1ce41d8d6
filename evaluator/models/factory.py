"""From `--agent model:…` to a contender; the provider's client is loaded here and not before."""

from collections.abc import Mapping

from evaluator.episode.contender import AgentContender
from evaluator.errors import UsageError
from evaluator.models.choice import Options, parse_model
from evaluator.models.lanes import Lanes, Patience


def model_contender(
    text: str,
    options: Options | None = None,
    base_url: str | None = None,
    lanes: Lanes | None = None,
    patience: Patience | None = None,
    environ: Mapping[str, str] | None = None,
) -> AgentContender:
    """The model that `text` names, ready to play.

    Args:
        text: `model:PRESET` or `model:PROVIDER:NAME`, with options behind it or without.
        options: Those of all models; what is written in `text` comes first.
        base_url: Where the model is asked instead of the provider's own place.
        lanes: Shared by all agents of a run, so that a provider's limit holds for them together.
        patience: How long a model is waited for.
        environ: Environment variables; by default those of the process.

    Raises:
        UsageError: There is no such model, something is missing to ask it, or it does not take an option.
    """
    choice = parse_model(text, options or Options(), base_url, environ)
    if lacking := choice.missing():
        raise UsageError(f"{text}: {'; '.join(lacking)}; see `physment-eval models`")
    from evaluator.models.agent import ModelAgent  # noqa: PLC0415 - loads the provider's client, half a second

    agent = ModelAgent(choice, (lanes or Lanes()).of(choice.provider.name), patience or Patience())
    return AgentContender(agent, agent.facts(), agent)
