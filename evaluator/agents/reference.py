"""Agents that play given calls: the protocols of scene packs (generators of calls), scripts, a constant answer."""

import functools
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError, UsageError, reason_of
from evaluator.records.episode import Episode, EpisodeKey, Exchange, ToolCall
from scenes import AnswerSpec, PackError, PackFiles, Scalar, draw_knobs, find_pack, read_pack, reference_of
from scenes.protocol import ANSWER, AnswerValue, Call, Exchanges, Protocol, Reading, load_solution
from scenes.reference_laws import stating


@dataclass(slots=True)
class ProtocolPlayer:
    """Plays a protocol, a generator of calls: each `yield` is one turn."""

    make: Callable[[str], Protocol]
    """Creates the protocol. Its docstring is recorded as the reasoning of the first turn."""
    prompt: str
    """The opening prompt."""
    protocol: Protocol = field(init=False)

    def __post_init__(self) -> None:
        self.protocol = self.make(self.prompt)

    async def act(self, feedback: Feedback | None) -> Reply:
        """Return the calls of the protocol's next `yield`.

        Raises:
            AgentError: The protocol raised an exception.
        """
        return self.reply(feedback)

    def reply(self, feedback: Feedback | None) -> Reply:
        """Do the same as `act` outside of an event loop, for example in a thread.

        Raises:
            AgentError: The protocol raised an exception.
        """
        try:
            if feedback is None:
                calls = next(self.protocol)
            else:
                calls = self.protocol.send([reading_of(exchange) for exchange in feedback.exchanges])
        except StopIteration:
            return Reply(reasoning="The protocol has ended.")
        except Exception as error:
            raise AgentError(f"the protocol failed: {error!r}") from error
        return Reply(
            reasoning=(self.make.__doc__ or "").strip() if feedback is None else "",
            calls=tuple(ToolCall(tool=call.tool, arguments=call.arguments) for call in calls),
        )


def reading_of(exchange: Exchange) -> Reading:
    """Convert the result of a call for a protocol: its content, `{"error": sentence}`, or `{}` if it was not run."""
    if exchange.is_error:
        return {"error": exchange.text}
    return dict(exchange.content or {}) if exchange.returned else {}


def calls_and_readings(episode: Episode) -> Exchanges:
    """Return the calls of an episode, each with its reading, without the answer.

    Tools take `1` for `object_1`; these calls have the whole identifier, with which fits compare it.
    """
    return [
        (Call(exchange.call.tool, _with_whole_ids(exchange.call.arguments)), reading_of(exchange))
        for turn in episode.turns
        for exchange in turn.exchanges
        if exchange.call.tool != ANSWER
    ]


def _with_whole_ids(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments in which the numbers of objects are replaced by their identifiers."""
    return {
        name: f"object_{value}" if name.endswith("_id") and isinstance(value, str) and value.isdecimal() else value
        for name, value in arguments.items()
    }


@dataclass(frozen=True, slots=True)
class ReferenceAgent:
    """Plays the reference protocol of a scene: `solve` in its `solution.py`."""

    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""
    name: str = "reference"
    """Name in records and tables."""

    def player(self, key: EpisodeKey, briefing: Briefing) -> ProtocolPlayer:
        """Start the reference protocol of the scene. Its answer contains a law if the scene asks for one.

        Raises:
            AgentError: The pack has no protocol.
        """
        try:
            files = find_pack(key.scene, self.scenes_dir)
            solve = load_solution(files).solve
        except PackError as error:
            raise AgentError(f"no reference protocol: {error}") from error
        if solve is None:
            raise AgentError(f"no reference protocol: solution.py of scene {reference_of(key.scene)} defines no solve")
        asks_for_law = any(
            tool.name == ANSWER and "law" in tool.input_schema.get("properties", {}) for tool in briefing.tools
        )
        return ProtocolPlayer(stating(files, solve) if asks_for_law else solve, briefing.prompt)


Script = tuple[tuple[ToolCall, ...], ...]

_FORM = '[[{"tool": "step", "arguments": {"duration": 0.1}}], [{"tool": "answer", "arguments": {"answer": 1}}]]'


@dataclass(frozen=True, slots=True)
class ScriptedAgent:
    """Plays one script in every scene, or a script for each scene."""

    name: str
    scripts: Mapping[int | None, Script]
    """Scene id → turns; the key None holds the turns for all other scenes."""

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_ScriptedPlayer":
        """Return a player for the scene's script.

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
    """Read a script: a list of turns, or an object that maps scene ids to lists of turns. A turn is a list of calls.

    Raises:
        UsageError: The file cannot be read or is malformed.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"the script {path} cannot be read: {reason_of(error)}") from error
    form = TypeAdapter(Script)
    try:
        if isinstance(raw, dict):
            return ScriptedAgent(f"scripted:{path.name}", TypeAdapter(dict[int | None, Script]).validate_python(raw))
        return ScriptedAgent(f"scripted:{path.name}", {None: form.validate_python(raw)})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise UsageError(f"the script {path} is malformed at {where}: {first['msg']}; a script is {_FORM}") from error


_DRAWS = range(1, 51)
"""Seeds whose keys determine the constant."""


@dataclass(frozen=True, slots=True)
class ConstantAgent:
    """Gives the same answer at every seed of a scene: the constant that is right most often over 50 seeds.

    A scene with a single variant, or whose key is computed with the physics engine, has no such constant.
    """

    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""
    name: str = "constant"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_ConstantPlayer":
        """Return a player that answers at once.

        Raises:
            AgentError: The scene has no constant.
        """
        del briefing
        try:
            return _ConstantPlayer(_constant(find_pack(key.scene, self.scenes_dir)))
        except PackError as error:
            raise AgentError(f"no constant: {error}") from error


@dataclass(slots=True)
class _ConstantPlayer:
    value: AnswerValue

    async def act(self, feedback: Feedback | None) -> Reply:
        del feedback
        return Reply("The same answer as always.", (ToolCall(tool=ANSWER, arguments={"answer": self.value}),))


@dataclass(frozen=True, slots=True)
class BatchAgent:
    """Plays the scene's `batch` protocol: the best solution that makes one fixed list of calls."""

    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""
    name: str = "batch"

    def player(self, key: EpisodeKey, briefing: Briefing) -> ProtocolPlayer:
        """Start the `batch` protocol of the scene.

        Raises:
            AgentError: The pack defines no `batch`.
        """
        try:
            batch = load_solution(find_pack(key.scene, self.scenes_dir)).batch
        except PackError as error:
            raise AgentError(f"no batch: {error}") from error
        if batch is None:
            raise AgentError(f"no batch: solution.py of scene {reference_of(key.scene)} defines none")
        return ProtocolPlayer(batch, briefing.prompt)


@functools.cache
def _constant(files: PackFiles) -> AnswerValue:
    pack, theory = read_pack(files), load_solution(files).theory
    if not pack.knobs or theory is None or pack.answer_spec is None:
        raise AgentError(f"no constant: the keys of scene {files.scene_id} do not follow from its draws by theory")
    keys = [theory(draw_knobs(files, pack, seed)) for seed in _DRAWS]
    return best_constant(keys, pack.answer_spec)[0]


def best_constant(keys: Sequence[AnswerValue], spec: AnswerSpec) -> tuple[AnswerValue, float]:
    """Return the constant that agrees with the most keys, and the share of keys that it agrees with.

    The numeric candidates are the keys themselves, their means and their median.

    Args:
        keys: Keys at several seeds.
        spec: Answer specification with the tolerances.
    """
    try:
        table = np.array([np.atleast_1d(np.asarray(key, dtype=float)) for key in keys])
    except ValueError:
        table = None
    if table is None or spec.options:
        words = [str(key) for key in keys]
        most = max(dict.fromkeys(words), key=words.count)
        return keys[words.index(most)], words.count(most) / len(words)
    tried = [*table, table.mean(axis=0), np.median(table, axis=0)]
    if (table > 0).all():
        tried.append(np.exp(np.log(table).mean(axis=0)))
    tolerance = spec.abs_tol + spec.rel_tol * np.abs(table)
    shares = [float((np.abs(table - constant) <= tolerance).all(axis=1).mean()) for constant in tried]
    best: list[Scalar] = [float(f"{value:.6g}") for value in tried[int(np.argmax(shares))]]
    return best if isinstance(keys[0], list) else best[0], max(shares)
