"""Agents that users write in Python: `--agent MODULE:CLASS` imports the class and handles its exceptions.

The class has the attribute `name` and the method `player` of the `Agent` protocol. It may also have a method `facts`,
which returns the settings that determine its results. It may be an async context manager, which is open during the run.
"""

import hashlib
import importlib
import inspect
import sys
import traceback
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from pydantic import JsonValue

from evaluator.episode.loop import AgentParticipant
from evaluator.episode.player import Agent, Briefing, Feedback, Player, Reply
from evaluator.errors import AgentError, EvaluatorError, UsageError
from evaluator.records.episode import EpisodeKey


def load_agent(text: str) -> AgentParticipant:
    """Load the agent that `MODULE:CLASS` names. The working directory is put on the import path.

    Args:
        text: Module and class, such as `my_agents.falling:FallingAgent`. The class is called without arguments.

    Raises:
        UsageError: The module or class cannot be loaded, or the object is not an agent.
    """
    module_name, _, class_name = text.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)
    try:
        module = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        if error.name != module_name.partition(".")[0]:
            raise UsageError(f"--agent {text}: importing {module_name} needs {error.name}, which is missing") from error
        raise UsageError(f"--agent {text}: there is no such agent, and no module {module_name} here") from error
    except Exception as error:
        raise UsageError(f"--agent {text}: the module {module_name} cannot be imported: {_sentence(error)}") from error
    factory = getattr(module, class_name, None)
    if not callable(factory):
        raise UsageError(f"--agent {text}: the module {module_name} has no class {class_name}")
    try:
        agent: Any = factory()
    except Exception as error:
        raise UsageError(f"--agent {text}: {class_name}() failed: {_sentence(error)}") from error
    if not isinstance(getattr(agent, "name", None), str) or not callable(getattr(agent, "player", None)):
        raise UsageError(f"--agent {text}: {class_name} needs a `name` (a string) and a method `player(key, briefing)`")
    stated = cast("dict[str, JsonValue]", agent.facts() if callable(getattr(agent, "facts", None)) else {})
    facts: dict[str, JsonValue] = {"class": text, **_source_of(cast("Agent", agent)), **stated}
    owned = agent if hasattr(agent, "__aenter__") else nullcontext()
    return AgentParticipant(GuardedAgent(agent), facts, owned)


def _source_of(agent: Agent) -> dict[str, str]:
    """Return a short hash of the agent's source file, so that a resumed run detects an edit."""
    try:
        source = Path(inspect.getfile(type(agent))).read_bytes()
    except (OSError, TypeError):
        return {}  # a class without a file, such as one of an interactive session
    return {"source": hashlib.sha256(source).hexdigest()[:12]}


@dataclass(frozen=True, slots=True)
class GuardedAgent:
    """Wraps an agent so that its exceptions end the episode instead of the run."""

    inner: Agent

    @property
    def name(self) -> str:
        """The inner agent's name."""
        return self.inner.name

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_GuardedPlayer":
        """Return the inner player, with its exceptions converted to `AgentError`.

        Raises:
            AgentError: The agent raised an exception.
        """
        try:
            return _GuardedPlayer(self.inner.player(key, briefing), self.name)
        except EvaluatorError:
            raise
        except Exception as error:
            raise AgentError(f"{self.name}: player() failed: {_sentence(error)}") from error


@dataclass(frozen=True, slots=True)
class _GuardedPlayer:
    inner: Player
    name: str

    async def act(self, feedback: Feedback | None) -> Reply:
        try:
            reply = cast("object", await self.inner.act(feedback))
        except EvaluatorError:
            raise
        except Exception as error:
            raise AgentError(f"{self.name}: act() failed: {_sentence(error)}") from error
        if not isinstance(reply, Reply):
            raise AgentError(f"{self.name}: act() returned {type(reply).__name__}, not a Reply")
        return reply


def _sentence(error: Exception) -> str:
    """Type and message of an exception, and the line of code that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {error}{where}"
