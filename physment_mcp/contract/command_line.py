"""Command lines of both programs: an argument parser with errors of one sentence, and the handling of Ctrl-C."""

import argparse
import difflib
import itertools
import shutil
import signal
import sys
import textwrap
import threading
from _thread import interrupt_main
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_AGAIN_S = 0.01
"""Delay after which a discarded KeyboardInterrupt is raised again [s]."""


class SentenceParser(argparse.ArgumentParser):
    """An ArgumentParser that raises an error instead of printing the usage and exiting. Its subparsers do the same."""

    usage_error: ClassVar[type[Exception]]
    """Exception class to raise; subclasses set it."""

    def parse_known_args(self, *args: Any, **kwargs: Any) -> Any:
        """Parse arguments, and refuse an unknown option before its value is taken for a positional argument.

        Raises:
            usage_error: The command line is invalid.
        """
        self._refuse_unknown_options(args[0])
        return super().parse_known_args(*args, **kwargs)

    def format_help(self) -> str:
        """Return the help text. No line, examples and their notes included, is longer than the terminal is wide."""
        width = shutil.get_terminal_size().columns
        blocks = itertools.groupby(super().format_help().splitlines(), key=_is_prose)
        wrapped = (_paragraph(list(lines), width) if prose else _examples(lines, width) for prose, lines in blocks)
        return "".join(f"{line}\n" for lines in wrapped for line in lines)

    def error(self, message: str) -> NoReturn:
        """Raise an error with the message and a pointer to `--help`.

        Raises:
            usage_error: Always.
        """
        raise self.usage_error(f"{message} (see {self.prog} --help)")

    def _refuse_unknown_options(self, words: Sequence[str]) -> None:
        options = [option for option in self._option_string_actions if option.startswith("--")]
        families = [action for action in self._actions if action.nargs == argparse.PARSER]
        commands = {name for family in families for name in family.choices or ()}
        for word in words:
            option = word.partition("=")[0]
            if word == "--" or word in commands:
                return  # the arguments after `--` belong to another program
            if option.startswith("--") and " " not in option and not any(one.startswith(option) for one in options):
                self.error(f"there is no option {option}{self._nearest(option.removeprefix('--'), options)}")

    def _nearest(self, word: str, options: Sequence[str]) -> str:
        """Suggest the option, or the argument without dashes, whose name is nearest to a misspelled one."""
        given = {action.dest: action for action in self._actions if not action.option_strings and action.dest != "help"}
        close = difflib.get_close_matches(word, [*given, *(option.removeprefix("--") for option in options)], n=1)
        if not close or close[0] not in given:
            return f"; did you mean --{close[0]}?" if close else ""
        action = given[close[0]]
        example = next(iter(action.choices)) if action.choices else action.metavar or action.dest.upper()
        return f"; {action.dest} is written without dashes: {self.prog} {example}"

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        close = did_you_mean(str(value), map(str, action.choices))
        if action.nargs == argparse.PARSER:
            raise argparse.ArgumentError(None, f"there is no command {value}{close}")
        raise argparse.ArgumentError(action, f"{value} is none of {', '.join(map(str, action.choices))}{close}")


def _is_prose(line: str) -> bool:
    return bool(line) and not line.startswith(" ")


def _paragraph(lines: list[str], width: int) -> list[str]:
    """Wrap a paragraph again if one of its lines is too long."""
    return lines if max(map(len, lines)) <= width else textwrap.wrap(" ".join(lines), width, break_on_hyphens=False)


def _examples(lines: Iterable[str], width: int) -> Iterator[str]:
    """If the line of a command with a note is too long, put the note on the next line. Wrap lines still too long."""
    for line in lines:
        indent = " " * (len(line) - len(line.lstrip()))
        command, gap, note = line.strip().partition("   ")
        parts = [line.strip()] if len(line) <= width or not gap else [command, f"    {note.strip()}"]
        for part in parts:
            inner = indent + " " * (len(part) - len(part.lstrip()))
            wrapped = textwrap.wrap(
                part.strip(), width - len(inner) - 4, break_long_words=False, break_on_hyphens=False
            )
            yield from (
                [line]
                if len(line) <= width
                else [f"{inner}{'    ' if number else ''}{text}" for number, text in enumerate(wrapped)]
            )


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Suggest the known word nearest to a misspelled one, as the end of a sentence; empty if none is near."""
    close = difflib.get_close_matches(word, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else ""


def restore_sigint() -> None:
    """Make Ctrl-C raise KeyboardInterrupt, once the modules of a command are imported.

    Python discards an exception that is raised in a finaliser or in a weak reference callback, and prints a traceback.
    A KeyboardInterrupt discarded in this way is raised again shortly afterwards.

    An ignored signal stays ignored.
    """
    if signal.getsignal(signal.SIGINT) is not signal.SIG_DFL:
        return
    signal.signal(signal.SIGINT, signal.default_int_handler)
    usual = sys.unraisablehook

    def hook(discarded: "UnraisableHookArgs") -> None:
        if not issubclass(discarded.exc_type, KeyboardInterrupt):
            usual(discarded)
            return
        again = threading.Timer(_AGAIN_S, _interrupt_main_thread)
        again.daemon = True
        again.start()

    sys.unraisablehook = hook


def _interrupt_main_thread() -> None:
    if sys.platform == "win32":
        interrupt_main()
    else:  # interrupt_main would not interrupt a blocking system call
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
