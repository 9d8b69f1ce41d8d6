"""The client side: opens laboratory sessions over MCP, lets agents play, grades, scores and reports.

The names below are the public interface for Python programs; docs/how-to/use-as-a-library.md shows their use. They
are loaded when first used, so that `import evaluator` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from evaluator.agents.reference import ReferenceAgent
    from evaluator.answers.rewards import AnswerReward
    from evaluator.episode.connect import EpisodeConnector
    from evaluator.episode.player import Agent, Briefing, Feedback, Player, Reply, ToolDescription
    from evaluator.episode.protocols.text import feedback_text
    from evaluator.errors import AgentError, EvaluatorError, InfrastructureError, StoreError, UsageError
    from evaluator.library import (
        StoredRun,
        connect,
        episode_of_log,
        grade,
        load_run,
        play,
        reward,
        score,
        split,
        summary,
    )
    from evaluator.records.episode import (
        Episode,
        EpisodeKey,
        Exchange,
        Grade,
        GradeRecord,
        Outcome,
        ToolCall,
        Turn,
        Usage,
        Verdict,
    )
    from evaluator.records.run import RunRecord
    from evaluator.scores.metrics import RunSummary
    from evaluator.scores.scored_episode import ScoredEpisode
    from evaluator.study.selection import Selected, select
    from scenes.splits import Split

__all__ = [
    "Agent",
    "AgentError",
    "AnswerReward",
    "Briefing",
    "Episode",
    "EpisodeConnector",
    "EpisodeKey",
    "EvaluatorError",
    "Exchange",
    "Feedback",
    "Grade",
    "GradeRecord",
    "InfrastructureError",
    "Outcome",
    "Player",
    "ReferenceAgent",
    "Reply",
    "RunRecord",
    "RunSummary",
    "ScoredEpisode",
    "Selected",
    "Split",
    "StoreError",
    "StoredRun",
    "ToolCall",
    "ToolDescription",
    "Turn",
    "Usage",
    "UsageError",
    "Verdict",
    "connect",
    "episode_of_log",
    "feedback_text",
    "grade",
    "load_run",
    "play",
    "reward",
    "score",
    "select",
    "split",
    "summary",
]

_HOMES = {
    "evaluator.agents.reference": ("ReferenceAgent",),
    "evaluator.answers.rewards": ("AnswerReward",),
    "evaluator.episode.connect": ("EpisodeConnector",),
    "evaluator.episode.player": ("Agent", "Briefing", "Feedback", "Player", "Reply", "ToolDescription"),
    "evaluator.errors": ("AgentError", "EvaluatorError", "InfrastructureError", "StoreError", "UsageError"),
    "evaluator.library": (
        "StoredRun",
        "connect",
        "episode_of_log",
        "grade",
        "load_run",
        "play",
        "reward",
        "score",
        "split",
        "summary",
    ),
    "evaluator.episode.protocols.text": ("feedback_text",),
    "evaluator.records.episode": (
        "Episode",
        "EpisodeKey",
        "Exchange",
        "Grade",
        "GradeRecord",
        "Outcome",
        "ToolCall",
        "Turn",
        "Usage",
        "Verdict",
    ),
    "evaluator.records.run": ("RunRecord",),
    "evaluator.scores.metrics": ("RunSummary",),
    "evaluator.scores.scored_episode": ("ScoredEpisode",),
    "evaluator.study.selection": ("Selected", "select"),
    "scenes.splits": ("Split",),
}
"""Module → the public names that it defines."""


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
