"""A person at a terminal as an agent, with the same briefing, tools and budget as every other agent."""

import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol, cast

from pydantic import JsonValue

from evaluator.episode.player import ANSWER, Briefing, Feedback, Reply
from evaluator.episode.protocols.typed import TypingError, parse_line, signature
from evaluator.errors import AgentError
from evaluator.records.episode import EpisodeKey, Exchange, ToolCall

COMMANDS = ("help", "task", "log", "note", "quit")
"""Commands that can be typed instead of calls. A command uses no iteration."""
_HELP = """\
A line is an iteration: one call, or several separated by ;
  step 0.5
  apply_force object_1 [1,0,0]; step 0.2; get_velocity object_1
  answer 1.23
Give arguments in their order, or as name=value. A mistyped line is not sent and costs nothing.

  help            this, and the tools          task    the task again
  help TOOL       what a tool does             log     what was measured so far
  note TEXT       a thought, for the record    quit    leave without an answer (as Ctrl-D, Ctrl-C)

"""

_COMMAS = re.compile(r"(?<![\w.,])(?<!\w\()[-+−]?[\d.]+(?:,[\d.]+)+")
"""Matches numbers joined by commas without a space, except function arguments as in `atan2(1,2)`."""


class Left(AgentError):
    """The person left without an answer."""


class Terminal(Protocol):
    """The terminal at which a person reads and types."""

    def show(self, text: str) -> None:
        """Show plain text."""
        ...

    def show_page(self, markdown: str) -> None:
        """Show a page of Markdown."""
        ...

    def ask(self, prompt: str, words: Sequence[str]) -> str:
        """Ask for a line.

        Args:
            prompt: Text shown in front of the line.
            words: Words that the terminal may complete.

        Raises:
            EOFError: There are no more lines.
            KeyboardInterrupt: The person wants to leave.
        """
        ...


def refuse_commas(calls: Sequence[ToolCall]) -> None:
    """Refuse answers with a comma that could be a decimal sign, a thousands separator or a list separator.

    An episode accepts only one answer, and 7,848 means 7.848 in many countries. A list in which every number has a
    decimal point, such as 3.26,16.6, is unambiguous.

    Raises:
        TypingError: An answer is ambiguous; the message says how to write it.
    """
    for call in calls:
        answer = call.arguments.get("answer") if call.tool == ANSWER else None
        texts = cast(list[object], answer) if isinstance(answer, list) else [answer]
        for text in texts:
            found = _COMMAS.finditer(text) if isinstance(text, str) else ()
            for written in (match[0] for match in found):
                parts = written.split(",")
                if not all("." in part for part in parts):
                    raise TypingError(
                        f"{written} can be read in several ways and is not sent; write {_readings(parts)}"
                    )


def _readings(parts: Sequence[str]) -> str:
    """Return an unambiguous spelling for each possible meaning of the commas: decimal, thousands or list separator."""
    ways = [f"{parts[0].replace('.', '')}.{parts[1]}"] if len(parts) == 2 and "." not in parts[1] else []
    ways += ["".join(parts)] if all(len(part.partition(".")[0]) == 3 for part in parts[1:]) else []
    return " or ".join([*ways, f"[{', '.join(parts)}]"])


@dataclass(frozen=True, slots=True)
class HumanAgent:
    """Asks the person at a terminal for each turn."""

    terminal: Terminal
    name: str = "human"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_HumanPlayer":
        """Show the task and a hint about help, and return the player."""
        del key
        player = _HumanPlayer(self.terminal, briefing)
        self.terminal.show_page(briefing.prompt)
        self.terminal.show("\nType help for how to call tools.")
        return player


@dataclass(slots=True)
class _HumanPlayer:
    terminal: Terminal
    briefing: Briefing
    seen: list[Feedback] = field(default_factory=list[Feedback])
    thoughts: list[str] = field(default_factory=list[str])

    async def act(self, feedback: Feedback | None) -> Reply:
        if feedback is not None:
            self.seen.append(feedback)
            self.terminal.show(_returns(feedback))
        left = self.briefing.budget if feedback is None else feedback.remaining
        while True:
            try:
                # Blocks the event loop on purpose: nothing else needs to run while the person thinks.
                line = self.terminal.ask(f"{left} iteration{'s' * (left != 1)} left > ", self._words()).strip()
            except (EOFError, KeyboardInterrupt):
                raise Left("the person left without an answer") from None
            if self._obey(line):
                continue
            try:
                calls = parse_line(line, self.briefing.tools)
                refuse_commas(calls)
            except TypingError as error:
                self.terminal.show(f"  {error}")
                continue
            if calls:
                reasoning, self.thoughts = "\n".join(self.thoughts), []
                return Reply(reasoning, calls)

    def _obey(self, line: str) -> bool:
        """Execute a command; return False if the line is not a command."""
        word, _, rest = line.partition(" ")
        match word:
            case "help":
                self.terminal.show(self._help(rest.strip()))
            case "task":
                self.terminal.show_page(self.briefing.prompt)
            case "log":
                log = [f"iteration {number}\n{_returns(seen)}" for number, seen in enumerate(self.seen, start=1)]
                self.terminal.show("\n".join(log) or "  nothing yet")
            case "note":
                self.thoughts.append(rest.strip())
            case "quit" | "exit":
                raise Left("the person left without an answer")
            case _:
                return False
        return True

    def _help(self, name: str) -> str:
        tools = {tool.name: tool for tool in self.briefing.tools}
        if not name:
            return _HELP + "\n".join(f"  {signature(tool)}" for tool in tools.values())
        if name not in tools:
            return f"  there is no tool {name!r}; type help for a list"
        tool = tools[name]
        lines = [
            f"  {signature(tool)}",
            textwrap.fill(tool.description, 100, initial_indent="  ", subsequent_indent="  "),
        ]
        for argument, schema in tool.input_schema.get("properties", {}).items():
            lines.append(f"    {argument}  {schema.get('description', '')}".rstrip())
        return "\n".join(lines)

    def _words(self) -> list[str]:
        """Names of tools, commands and objects, for completion."""
        ids = [str(listed["object_id"]) for listed in self.briefing.scene.get("objects", [])]
        for feedback in self.seen:
            for exchange in feedback.exchanges:
                ids += _ids(exchange.content)
        return [*(tool.name for tool in self.briefing.tools), *COMMANDS, *dict.fromkeys(ids)]


def _returns(feedback: Feedback) -> str:
    """Format the results of an iteration for a person."""
    lines = [_return(exchange) for exchange in feedback.exchanges]
    return "\n".join([*lines, f"  {feedback.note}"] if feedback.note else lines)


def _return(exchange: Exchange) -> str:
    call = exchange.call
    typed = " ".join([call.tool, *(_readable(value) for value in call.arguments.values())])
    if not exchange.returned:
        return f"  {typed}: not run{f', {exchange.text}' if exchange.text else ''}"
    if exchange.is_error:
        return f"  {typed}: {exchange.text}"
    fields = [
        f"      {name}  {_readable(value)}" for name, value in (exchange.content or {}).items() if value is not None
    ]
    return "\n".join([f"  {typed}", *fields])


def _readable(value: JsonValue) -> str:
    """Format a value with eight significant digits, which hides rounding noise but no measured digit."""
    match value:
        case None:
            return "n/a"
        case bool():
            return str(value).lower()
        case float():
            return f"{value:.8g}"
        case list():
            parts = [_readable(item) for item in value]
            rows = any(isinstance(item, dict) for item in value)
            return "\n        ".join(["", *parts]) if rows else f"[{', '.join(parts)}]"
        case dict():
            return "  ".join(f"{name} {_readable(item)}" for name, item in value.items())
        case _:
            return str(value)


def _ids(content: JsonValue) -> list[str]:
    """Collect the object ids anywhere in a result."""
    if isinstance(content, list):
        return [object_id for part in content for object_id in _ids(part)]
    if not isinstance(content, dict):
        return []
    own = content.get("object_id")
    return [
        *([own] if isinstance(own, str) else []),
        *(object_id for part in content.values() for object_id in _ids(part)),
    ]
