"""Generate the reference page of the command lines from their argparse parsers."""

import argparse
import re
from collections.abc import Iterator

import evaluator.commands.program as physment_eval
import physment_mcp.commands.program
from evaluator.commands.overview import COMMANDS
from evaluator.report.export import markdown_table

_HEAD = """\
# The command lines

Made from the parsers of the programs by `pytest tests/test_references.py --update-goldens`; do not edit. Each command
prints the same with `--help`.
"""


Parsers = dict[str, tuple[str, argparse.ArgumentParser]]
"""Each command's name, its summary line in the list of commands, and its parser."""


def cli_page() -> str:
    """Return the text of the page. Omits commands that the `--help` of their program does not list."""
    laboratory, (evaluator, _) = physment_mcp.commands.program.parser(), physment_eval.parser("--help")
    commands = {name: (what, physment_eval.parser(name)[1][name]) for name, (_, what) in COMMANDS.items() if what}
    parts = [_HEAD, *_program(laboratory, listed(laboratory)), *_program(evaluator, commands)]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _program(program: argparse.ArgumentParser, commands: Parsers) -> Iterator[str]:
    yield f"## `{program.prog}`"
    yield from _described(program)
    for name, (what, command) in commands.items():
        yield f"### `{program.prog} {name}`"
        # The default command has the description of the whole program.
        yield from _described(command, what, described=command.description != program.description)
        for word, (action_what, action) in listed(command).items():
            yield f"#### `{program.prog} {name} {word}`"
            yield from _described(action, action_what)


def listed(parser: argparse.ArgumentParser) -> Parsers:
    """Return the commands that `--help` lists, each with its summary line and its parser."""
    return {
        listed.dest: (listed.help or "", action.choices[listed.dest])
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
        for listed in action._choices_actions
    }


def _described(parser: argparse.ArgumentParser, what: str = "", *, described: bool = True) -> Iterator[str]:
    """Format a parser: its description, and a table of the arguments and options of each group."""
    yield from _prose((described and parser.description) or f"{what[:1].upper()}{what[1:]}.")
    for group in parser._action_groups:
        rows = [
            (_word(action), _meaning(action))
            for action in group._group_actions
            if action.help != argparse.SUPPRESS and not _is_choice_of_commands(action) and action.dest != "help"
        ]
        if not rows:
            continue
        titled = group.title not in {"positional arguments", "options"}
        if titled:
            yield f"**{str(group.title)[:1].upper()}{str(group.title)[1:]}**"
            if group.description:
                yield from _prose(group.description)
        yield markdown_table(("argument" if group.title == "positional arguments" else "option", "meaning"), rows)


def _is_choice_of_commands(action: argparse.Action) -> bool:
    return isinstance(action, argparse._SubParsersAction)


def _word(action: argparse.Action) -> str:
    """An option or an argument as it is typed."""
    value = action.metavar or (f"{{{','.join(map(str, action.choices))}}}" if action.choices else action.dest.upper())
    typed = " ".join(value) if isinstance(value, tuple) else value
    if not action.option_strings:
        return f"`{typed}`" + (" …" if action.nargs in {"+", "*", argparse.REMAINDER} else "")
    names = ", ".join(action.option_strings)
    return f"`{names}`" if action.nargs == 0 else f"`{names} {typed}`"


def _meaning(action: argparse.Action) -> str:
    said = _plain((action.help or "") % {**vars(action), "prog": ""})
    return f"{said} **(required)**" if action.option_strings and action.required else said


def _prose(text: str) -> Iterator[str]:
    """Convert a description to Markdown paragraphs; indented lines, which are examples, become code blocks."""
    for paragraph in re.split(r"\n{2,}", text.strip("\n")):
        for indented, lines in _runs(paragraph.split("\n")):
            yield "```text\n" + "\n".join(lines) + "\n```" if indented else _plain(" ".join(lines))


def _runs(lines: list[str]) -> Iterator[tuple[bool, list[str]]]:
    """Split lines into runs of indented and unindented lines, and remove the common indentation of each run."""
    start = 0
    for end in range(1, len(lines) + 1):
        if end == len(lines) or lines[end].startswith(" ") != lines[start].startswith(" "):
            run = lines[start:end]
            margin = min(len(line) - len(line.lstrip()) for line in run)
            yield lines[start].startswith(" "), [line[margin:].rstrip() for line in run]
            start = end


def _plain(text: str) -> str:
    """Escape text outside backquotes, so that Markdown shows it literally."""
    return "".join(
        part if part.startswith("`") else re.sub(r"([\\*_\[\]<])", r"\\\1", part)
        for part in re.split(r"(`[^`]+`)", text)
    )
