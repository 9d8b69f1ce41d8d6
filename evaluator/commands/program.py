"""Command line of the evaluator: study files, signals, and exit codes for the errors of commands.

All modules of the evaluator except `errors` and `overview` are imported inside functions, and only the module of the
requested command is imported, so that `--help` is fast.
"""

import argparse
import contextlib
import gc
import signal
import sys
import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib import import_module, metadata, util
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from evaluator.commands.overview import COMMANDS, COMMANDS_GROUP, DESCRIPTION, plugin
from evaluator.errors import InfrastructureError, StoreError, UsageError, reason_of
from physment_mcp.contract.command_line import SentenceParser, did_you_mean, restore_sigint

_OPEN_FILES = 65_536
"""Soft limit of open files and connections to request, if the system allows it."""
_SIGNS = [sign for name in ("SIGINT", "SIGTERM", "SIGHUP") if (sign := getattr(signal, name, None)) is not None]
"""Signals that end the program; Windows has no SIGHUP. SIGINT is first, because the others get its handler."""


def make_room() -> None:
    """Raise GC thresholds and the limit of open files, for hundreds of open episodes."""
    # With the default thresholds, searching these objects for cycles took a third of the processor time of 500
    # episodes.
    gc.set_threshold(10_000, 20, 20)
    if util.find_spec("resource") is None:
        return  # Windows has no limit of open files to raise
    import resource  # noqa: PLC0415

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):  # macOS may allow less than it reports
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def end_in_order() -> None:
    """Handle SIGTERM and SIGHUP like Ctrl-C: stop child processes and keep every finished episode on disk.

    Before this call, these signals end the process silently. A KeyboardInterrupt raised while modules are imported is
    unreliable: pydantic, while it builds a model, and C extensions, while they initialise, replace it by other errors.

    An ignored signal, such as SIGHUP under `nohup`, stays ignored.
    """
    restore_sigint()
    for sign in _SIGNS[1:]:
        if signal.getsignal(sign) is signal.SIG_DFL:
            signal.signal(sign, _interrupt)


def end_at_once() -> None:
    """Restore the default signal actions: the work is done, and only the interpreter has to exit."""
    for sign in reversed(_SIGNS):
        if signal.getsignal(sign) not in {signal.SIG_IGN, None}:
            signal.signal(sign, signal.SIG_DFL)


def _interrupt(_sign: int, _frame: FrameType | None) -> None:
    # SIGINT is ignored if a script starts this program in the background; SIGTERM must end the program even then.
    if signal.getsignal(signal.SIGINT) in {signal.SIG_IGN, None}:
        raise KeyboardInterrupt
    signal.raise_signal(signal.SIGINT)


Scalar = str | int | float | bool


RENAMED = {"--trust-edited": "--allow-modified", "--home-from": "--home-template"}
"""Option of version 0.1 → its name since 0.2. Version 0.3 will not accept the old names."""


def with_new_names(words: Sequence[str], note: Callable[[str], None]) -> list[str]:
    """Replace option names of version 0.1 before `--`; calls `note` with a sentence for each."""
    found: list[str] = []
    for at, word in enumerate(words):
        if word == "--":
            return [*found, *words[at:]]
        name, equals, value = word.partition("=")
        if name in RENAMED:
            note(f"{name} is called {RENAMED[name]} now; version 0.3 will not know the old name")
        found.append(f"{RENAMED.get(name, name)}{equals}{value}")
    return found


def with_config(words: Sequence[str], options: Collection[str]) -> list[str]:
    """Put the options of the file that `--config` names before those of the command line, so that the latter win.

    A key is a long option without its dashes (`max-cost` or `max_cost`). The values of a list are joined by commas; for
    `agent`, the option is repeated for each value. The value `true` sets an option that takes no value.

    Args:
        words: Words of the command line, with or without `--config FILE`.
        options: All long options, with their dashes.

    Raises:
        UsageError: The file cannot be read, or has a key that is not an option.
    """
    words = list(words)
    end = words.index("--") if "--" in words else len(words)
    place = next(
        (at for at, word in enumerate(words[:end]) if word == "--config" or word.startswith("--config=")), None
    )
    if place is None:
        return words
    _, equals, value = words[place].partition("=")
    if not equals and place + 1 >= end:
        raise UsageError("--config needs a file, such as --config study.toml")
    file = Path(value if equals else words[place + 1])
    rest = words[:place] + words[place + (1 if equals else 2) :]
    own = rest[: rest.index("--")] if "--" in rest else rest
    given = {word.partition("=")[0] for word in own}
    from_file: list[str] = []
    for key, content in _read(file).items():
        option = f"--{key.replace('_', '-')}"
        if option not in {*options, *RENAMED} or option == "--config":
            raise UsageError(f"{file}: there is no option {key!r}; see physment-eval run --help")
        # Skip options that the command line sets: a repeatable option would get the values of both.
        if option not in given:
            from_file += _words(option, content, file)
    return from_file + rest


def _read(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--config {file}: cannot be read ({reason_of(error)})") from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"--config {file}: is not TOML: {error}") from error


def _words(option: str, content: Any, file: Path) -> list[str]:
    if content is True:
        return [option]
    if content is False:
        return []
    if isinstance(content, list) and option == "--agent":
        return [word for value in content for word in (option, str(value))]  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - TOML
    if isinstance(content, list):
        return [f"{option}={','.join(map(str, content))}"]  # pyright: ignore[reportUnknownArgumentType] - TOML
    if isinstance(content, Scalar):
        return [f"{option}={content}"]
    raise UsageError(f"{file}: {option.removeprefix('--')} must be a value or a list")


if TYPE_CHECKING:
    from evaluator.commands.base import Commands


class Parser(SentenceParser):
    """The parser of this command line."""

    usage_error = UsageError


def main(argv: Sequence[str] | None = None, begin: Callable[[], None] = lambda: None) -> int:
    """Run the command line; returns the exit code.

    Args:
        argv: Words of the command line; default: those of this process.
        begin: Called after the modules of the command are imported and before the command runs.
    """
    make_room()
    try:
        args = parsed(sys.argv[1:] if argv is None else argv)
        begin()
        return args.run(args)
    except (UsageError, StoreError) as error:
        return _fail(str(error), 2)
    except InfrastructureError as error:
        return _fail(str(error), 1)
    except KeyboardInterrupt:
        print("physment-eval: interrupted", file=sys.stderr)
        return 130


def parsed(argv: Sequence[str]) -> argparse.Namespace:
    """Parse a command line. The attribute `run` of the result executes the command.

    Raises:
        UsageError: The command line is invalid, or its study file cannot be used.
        SystemExit: The command line requests help or the version.
    """
    words = list(argv)
    if words[:1] == ["play"] and sys.stderr.isatty() and not {"-h", "--help"} & set(words):
        _note("opens the laboratory …")  # at once: the modules of the command take seconds to import
    # `run` is the default command: insert it if the first word is an option.
    if not words or (words[0].startswith("-") and words[0] not in {"-h", "--help", "--version"}):
        words.insert(0, "run")
    elif words[0] not in COMMANDS and not words[0].startswith("-"):
        close = did_you_mean(words[0], COMMANDS)
        raise UsageError(f"there is no command {words[0]}{close} (see physment-eval --help)")
    program, commands = parser(words[0])
    if words[0] == "run":
        from evaluator.commands.run_options import long_options  # noqa: PLC0415

        words = ["run", *with_config(words[1:], long_options(commands["run"]))]
    return program.parse_args(with_new_names(words, _note))


def parser(command: str) -> tuple[argparse.ArgumentParser, Mapping[str, argparse.ArgumentParser]]:
    """Build the parser for one command; returns it and the parsers of all commands by name.

    Args:
        command: Name of the command. Only its module is imported, so the other commands have no options. An unknown
            name imports no module, which suffices to list the commands.

    Raises:
        UsageError: The command belongs to a plugin that is not installed.
    """
    program = Parser("physment-eval", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    program.add_argument("--version", action="version", version=f"physment-eval {metadata.version('physment-mcp')}")
    commands = program.add_subparsers(dest="command", metavar="COMMAND", required=True)
    if command in COMMANDS:
        _declare(command, COMMANDS[command][0], commands)
    else:
        for name, (_, what) in COMMANDS.items():
            if what:
                commands.add_parser(name, help=what)
    return program, commands.choices


def _declare(command: str, module: str, commands: "Commands") -> None:
    if module:
        import_module(f"evaluator.commands.{module}").add(commands)
        return
    plugin(COMMANDS_GROUP, command, command)(commands.add_parser(command))


def _note(sentence: str) -> None:
    print(f"physment-eval: {sentence}", file=sys.stderr)


def _fail(sentence: str, code: int) -> int:
    print(f"physment-eval: {sentence}", file=sys.stderr)
    return code
