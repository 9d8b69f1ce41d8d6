"""Presentations: the same episode with a paraphrased prompt, other units, other object ids, or lists in reverse order.

A `Translation` converts what the laboratory sends before the agent reads it, and converts the agent's calls back.
Records hold the laboratory's own texts and numbers, so a run is graded, replayed and compared like any other. The
translation depends only on the text, never on hidden values, so it neither hides nor adds information.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from pydantic import JsonValue

from evaluator.agents.unit_system import SENTENCES, described_units, exchanged, exchanged_schema
from evaluator.episode.player import Agent, Briefing, Feedback, Player, Reply, ToolDescription
from evaluator.errors import UsageError
from evaluator.records.episode import EpisodeKey, Exchange, ToolCall


class Change(StrEnum):
    """A change that a presentation makes to the texts, ids, lists or units of the laboratory."""

    PARAPHRASE = "paraphrase"
    """The prompt is paraphrased; the statement of the task is not changed."""
    NAMES = "names"
    """Objects have other ids, such as sample_q for object_1."""
    ORDER = "order"
    """Lists of objects are reversed."""
    UNITS = "units"
    """Arguments and results of the tools are in centimetres, milliseconds and grams; task and law stay in SI."""


PARAPHRASES = (
    (
        "You are an experimental physicist in a simulated laboratory. Nothing is known but what you are told here and"
        " what you measure.",
        "You work as an experimental physicist, in a laboratory that is simulated. You know only what this text says"
        " and what you find by measuring.",
    ),
    (
        "SI units. World frame, z up. Vectors are [x, y, z], quaternions [w, x, y, z].",
        "All quantities are in SI units, in the world frame, whose z axis points up. A vector is written [x, y, z], a"
        " quaternion [w, x, y, z].",
    ),
    (
        "Sizes are full edge lengths along the object's own axes.",
        "A size gives the whole lengths of the edges, along the axes of the object itself.",
    ),
    (
        "A call that would go beyond a limit is refused, says what is left, and changes nothing.",
        "If a call would exceed a limit, it is not carried out: nothing changes, and the reply says how much is left.",
    ),
    (
        "Whatever is computed from readings is as fine as they are. Objects are put to places no more finely than"
        " positions are read.",
        "Values computed from readings have the resolution of the readings, and objects are placed no more finely than"
        " positions are read.",
    ),
    (
        "A second reading at the same moment repeats the first; errors at different moments differ.",
        "Reading twice at one moment gives the same value; at another moment the error is another one.",
    ),
    (
        "A call that cannot be done returns one sentence that says why, and changes nothing.",
        "If a call is impossible, one sentence gives the reason, and the scene stays as it is.",
    ),
    ("To answer, call `answer` with your final answer.", "Give your final answer by calling `answer`."),
    (
        "An iteration is one reply of yours, with as many tool calls as you like. If you have not answered when they"
        " are used up, the task counts as failed.",
        "Each reply of yours is one iteration and may hold any number of tool calls. Without an answer by the last of"
        " them, the task counts as failed.",
    ),
    (
        "The calls of a reply run in order. A call that fits no tool ends them: the calls before it stand, the call and"
        " those after it are not run. A call that the laboratory refuses does not end them.",
        "Calls of one reply are run one after the other. At a call that fits no tool they stop: earlier calls keep"
        " their effect, this one and later ones are not run. After a call that the laboratory refuses they go on.",
    ),
    (
        "Time stands still until you call `step`. Forces and torques keep acting until you set them again. Assume"
        " nothing that you can measure. You can answer once; the answer ends the episode.",
        "No time passes except in `step`. A force or torque acts until you set another. Do not assume what could be"
        " measured. There is one answer, and it ends the episode.",
    ),
    (
        "Before each set of calls, say in a sentence or two why you make them.",
        "Explain each set of calls in one or two sentences before you make it.",
    ),
)
"""Sentences of the opening prompt, each with its paraphrase."""

_LISTS = frozenset({"objects", "revealed", "included", "excluded", "also_deleted"})
"""Fields of results, and of the scene's resource, that list objects."""
_ID = re.compile(r"\b(?:object_(?P<number>0|[1-9]\d{0,5})|sample_(?P<letters>[a-z]{1,5}))(?=_[a-z]|\b)")
"""Matches an object id, also at the start of a variable name in a law, such as `object_1_vx`."""
_FIRST = 16
"""Offset between the number and the letters of an object id: `object_1` becomes `sample_q`."""
_ROWS = re.compile(r"(?<=\n\|---)((?:\|---)+\|\n)((?:\| .*\n?)+)")
"""Matches the rows of the first table of a prompt, which lists the objects."""


@dataclass(frozen=True, slots=True)
class Translation:
    """Converts texts and values of the laboratory into a presentation, or back if it is the inverse."""

    presentation: tuple[Change, ...]
    inverse: bool = False

    def text(self, text: str) -> str:
        """Replace each object id in a text by its counterpart. A second application restores the text."""
        return _ID.sub(_other_id, text) if Change.NAMES in self.presentation else text

    def prompt(self, text: str) -> str:
        """Convert an opening prompt."""
        if Change.UNITS in self.presentation:  # before the paraphrases, one of which speaks of SI units
            text = _exchanged(text, SENTENCES, inverse=self.inverse)
        if Change.PARAPHRASE in self.presentation:
            text = _exchanged(text, PARAPHRASES, inverse=self.inverse)
        if Change.ORDER in self.presentation:
            text = _ROWS.sub(lambda table: table[1] + _reversed_rows(table[2]), text, count=1)
        return self.text(text)

    def value(self, value: JsonValue, *, listed: bool = False) -> JsonValue:
        """Convert a result, an argument or a schema.

        Args:
            value: The JSON value.
            listed: Whether it is a list of objects, whose order may be reversed.
        """
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, dict):
            return {self.text(name): self.value(part, listed=name in _LISTS) for name, part in value.items()}
        if isinstance(value, list):
            parts = [self.value(part) for part in value]
            return parts[::-1] if listed and Change.ORDER in self.presentation else parts
        return value

    def briefing(self, briefing: Briefing) -> Briefing:
        """Convert the briefing that an agent receives before its first turn."""
        tools = tuple(
            ToolDescription(
                tool.name,
                self.text(self._described(tool.description)),
                self._members(self._schema(tool.name, tool.input_schema)),
            )
            for tool in briefing.tools
        )
        scene = self._members(dict(briefing.scene))
        return replace(briefing, prompt=self.prompt(briefing.prompt), tools=tools, scene=scene)

    def feedback(self, feedback: Feedback) -> Feedback:
        """Convert the feedback that an agent receives after a turn."""
        return Feedback(
            [self._exchange(exchange) for exchange in feedback.exchanges], self.text(feedback.note), feedback.remaining
        )

    def reply(self, reply: Reply) -> Reply:
        """Convert the text and the calls of an agent's turn."""
        thought = self.text(reply.reasoning[: reply.thought_chars])
        said = self.text(reply.reasoning[reply.thought_chars :])
        calls = tuple(self._call(call) for call in reply.calls)
        return replace(reply, reasoning=thought + said, thought_chars=len(thought), calls=calls)

    def _call(self, call: ToolCall) -> ToolCall:
        return call.model_copy(update={"arguments": self._members(self._numbers(call.tool, call.arguments))})

    def _described(self, text: str) -> str:
        return described_units(text, inverse=self.inverse) if Change.UNITS in self.presentation else text

    def _schema(self, tool: str, schema: Mapping[str, Any]) -> dict[str, Any]:
        changes = Change.UNITS in self.presentation
        return exchanged_schema(tool, schema, inverse=self.inverse) if changes else dict(schema)

    def _numbers(self, tool: str, members: dict[str, JsonValue]) -> dict[str, JsonValue]:
        """Convert the units of arguments or of a result."""
        return exchanged(tool, members, inverse=self.inverse) if Change.UNITS in self.presentation else members

    def _members(self, members: dict[str, JsonValue]) -> dict[str, JsonValue]:
        changed = self.value(members)
        assert isinstance(changed, dict)
        return changed

    def _exchange(self, exchange: Exchange) -> Exchange:
        tool, content = exchange.call.tool, exchange.content
        content = None if content is None else self._members(self._numbers(tool, content))
        try:
            read: JsonValue = json.loads(exchange.text)
            read = self._numbers(tool, read) if isinstance(read, dict) else read
            text = json.dumps(self.value(read), ensure_ascii=False, separators=(",", ":"))
        except ValueError:
            text = self.text(exchange.text)
        return exchange.model_copy(update={"call": self._call(exchange.call), "content": content, "text": text})


def _exchanged(text: str, pairs: Sequence[tuple[str, str]], *, inverse: bool) -> str:
    for pair in pairs:
        before, after = reversed(pair) if inverse else pair
        text = text.replace(before, after)
    return text


def _other_id(found: re.Match[str]) -> str:
    if found["number"] is not None:
        left, letters = int(found["number"]) + _FIRST, ""
        while left > 0:
            left, place = divmod(left - 1, 26)
            letters = chr(ord("a") + place) + letters
        return f"sample_{letters}"
    number = -_FIRST + sum((ord(sign) - ord("a") + 1) * 26**place for place, sign in enumerate(found["letters"][::-1]))
    return f"object_{number}" if 0 <= number < 10**6 else found[0]


def _reversed_rows(rows: str) -> str:
    return "".join(f"{row}\n" for row in reversed(rows.splitlines()))


@dataclass(frozen=True, slots=True)
class TranslatedAgent:
    """Wraps an agent, so that it plays the episode in another presentation."""

    inner: Agent
    translation: Translation

    @property
    def name(self) -> str:
        """Name of the inner agent. The record of the run states the presentation."""
        return self.inner.name

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_TranslatedPlayer":
        """Return the inner agent's player, wrapped so that it plays in another presentation."""
        translation = self.translation
        back = replace(translation, inverse=not translation.inverse)
        return _TranslatedPlayer(self.inner.player(key, translation.briefing(briefing)), translation.feedback, back)


@dataclass(slots=True)
class _TranslatedPlayer:
    inner: Player
    shown: Callable[[Feedback], Feedback]
    back: Translation

    async def act(self, feedback: Feedback | None) -> Reply:
        return self.back.reply(await self.inner.act(None if feedback is None else self.shown(feedback)))


def presented(agent: Agent, presentation: Sequence[Change], *, speaks_original: bool) -> Agent:
    """Wrap an agent, so that it plays episodes in another presentation.

    Args:
        agent: The agent.
        presentation: The changes; an agent without changes is returned unwrapped.
        speaks_original: Whether the agent is a program written for the laboratory's own names and units, such as the
            reference protocols. Its input is then converted back, so that it tests only whether the presentation can be
            inverted.
    """
    if not presentation:
        return agent
    translation = Translation(tuple(presentation))
    if speaks_original:
        agent = TranslatedAgent(agent, replace(translation, inverse=True))
    return TranslatedAgent(agent, translation)


def parse_presentation(text: str) -> tuple[Change, ...]:
    """Read the value of `--presentation`, such as `names` or `paraphrase,order`.

    Raises:
        UsageError: A part is not the name of a change.
    """
    parts = dict.fromkeys(part.strip() for part in text.split(",")) if text else {}
    for part in parts:
        if part not in set(Change):
            raise UsageError(f"--presentation {part}: the changes are {', '.join(Change)}; commas separate several")
    return tuple(change for change in Change if change in parts)
