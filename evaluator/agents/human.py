"""A person at a terminal as an agent: the same briefing, the same tools, the same budget."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from pydantic import JsonValue

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError
from evaluator.protocols.typed import TypingError, parse_line, signature
from evaluator.records import EpisodeKey, Exchange

COMMANDS = ("help", "task", "log", "note", "quit")
"""What can be typed besides calls; none of it costs an iteration."""
_HELP = """\
A line is an iteration: one call, or several separated by ;
  step 0.5
  apply_force object_1 [1,0,0]; step 0.2; get_velocity object_1
  answer 1.23
Arguments stand in their order, or as name=value. What is mistyped is not sent and costs nothing.

  help            this, and the tools          task    the task again
  help TOOL       what a tool does             log     what was measured so far
  note TEXT       a thought, for the record    quit    leave without an answer (as Ctrl-D, Ctrl-C)

"""


class Left(AgentError):
    """The person left without an answer."""


class Terminal(Protocol):
    """Where a person reads and types."""

    def show(self, text: str) -> None:
        """Show plain text."""
        ...

    def show_page(self, markdown: str) -> None:
        """Show a page of Markdown."""
        ...

    def ask(self, prompt: str, words: Sequence[str]) -> str:
        """Ask for a line.

        Args:
            prompt: What stands before it.
            words: What the person may want to have completed.

        Raises:
            EOFError: There are no more lines.
            KeyboardInterrupt: The person wants to leave.
        """
        ...


@dataclass(frozen=True, slots=True)
class HumanAgent:
    """Asks whoever sits at a terminal."""

    terminal: Terminal
    name: str = "human"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_HumanPlayer":
        """Show the task, and how to type."""
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
                # Blocks the event loop, on purpose: nothing else is to happen while a person thinks.
                line = self.terminal.ask(f"{left} iteration{'s' * (left != 1)} left > ", self._words()).strip()
            except (EOFError, KeyboardInterrupt):
                raise Left("the person left without an answer") from None
            if self._obey(line):
                continue
            try:
                calls = parse_line(line, self.briefing.tools)
            except TypingError as error:
                self.terminal.show(f"  {error}")
                continue
            if calls:
                said, self.thoughts = "\n".join(self.thoughts), []
                return Reply(said, calls)

    def _obey(self, line: str) -> bool:
        """Do what a command says; false if the line is none."""
        word, _, rest = line.partition(" ")
        match word:
            case "help":
                self.terminal.show(self._help(rest.strip()))
            case "task":
                self.terminal.show_page(self.briefing.prompt)
            case "log":
                log = [f"iteration {count}\n{_returns(one)}" for count, one in enumerate(self.seen, start=1)]
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
        for one, schema in tool.input_schema.get("properties", {}).items():
            lines.append(f"    {one}  {schema.get('description', '')}".rstrip())
        return "\n".join(lines)

    def _words(self) -> list[str]:
        """Names of tools, commands and objects."""
        ids = [str(one["object_id"]) for one in self.briefing.scene.get("objects", [])]
        for feedback in self.seen:
            for one in feedback.exchanges:
                ids += _ids(one.content)
        return [*(tool.name for tool in self.briefing.tools), *COMMANDS, *dict.fromkeys(ids)]


def _returns(feedback: Feedback) -> str:
    """What came of an iteration, for a person to read."""
    lines = [_return(one) for one in feedback.exchanges]
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
    """A value for a person: numbers to eight digits, which hides arithmetic noise and no measurement."""
    match value:
        case None:
            return "n/a"
        case bool():
            return str(value).lower()
        case float():
            return f"{value:.8g}"
        case list():
            parts = [_readable(one) for one in value]
            rows = any(isinstance(one, dict) for one in value)
            return "\n        ".join(["", *parts]) if rows else f"[{', '.join(parts)}]"
        case dict():
            return "  ".join(f"{name} {_readable(one)}" for name, one in value.items())
        case _:
            return str(value)


def _ids(content: JsonValue) -> list[str]:
    """Ids of objects anywhere in a return."""
    if isinstance(content, list):
        return [one for part in content for one in _ids(part)]
    if not isinstance(content, dict):
        return []
    own = content.get("object_id")
    return [*([own] if isinstance(own, str) else []), *(one for part in content.values() for one in _ids(part))]
