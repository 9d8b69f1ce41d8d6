"""An agent that plays turns from a file, for tests, demonstrations and comparisons of transports."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError, UsageError
from evaluator.records.episode import EpisodeKey, ToolCall
from scenes.world_names import reference_of

Script = tuple[tuple[ToolCall, ...], ...]

_FORM = '[[{"tool": "step", "arguments": {"duration": 0.1}}], [{"tool": "answer", "arguments": {"answer": 1}}]]'


@dataclass(frozen=True, slots=True)
class ScriptedAgent:
    """Plays one script in every scene, or a script for each scene."""

    name: str
    scripts: Mapping[int | None, Script]
    """Scene id → turns; the key None holds the turns for all other scenes."""

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_ScriptedPlayer":
        """The player of the scene's script.

        Raises:
            AgentError: There is no script for this scene.
        """
        del briefing
        script = self.scripts.get(key.scene, self.scripts.get(None))
        if script is None:
            raise AgentError(f"the script has no turns for scene {reference_of(key.scene)}")
        return _ScriptedPlayer(script)


@dataclass(slots=True)
class _ScriptedPlayer:
    script: Script
    turn: int = 0

    async def act(self, feedback: Feedback | None) -> Reply:
        del feedback
        calls = self.script[self.turn] if self.turn < len(self.script) else ()
        self.turn += 1
        return Reply(calls=calls)


def load_script(path: Path) -> ScriptedAgent:
    """Read a script: a list of turns, or an object with such a list for each scene id. A turn is a list of calls.

    Raises:
        UsageError: The file cannot be read, or has another form.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"the script {path} cannot be read: {error}") from error
    form = TypeAdapter(Script)
    try:
        if isinstance(raw, dict):
            return ScriptedAgent(f"scripted:{path.name}", TypeAdapter(dict[int | None, Script]).validate_python(raw))
        return ScriptedAgent(f"scripted:{path.name}", {None: form.validate_python(raw)})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise UsageError(f"the script {path} is malformed at {where}: {first['msg']}; a script is {_FORM}") from error
