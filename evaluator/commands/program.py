"""Command line of the evaluator: lists the commands, and turns their errors into exit codes.

Modules of the evaluator except `errors` are imported inside functions, and of the commands only the one that is asked
for, so that `--help` answers at once.
"""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING

from evaluator.errors import UsageError
from physment_mcp.contract.command_line import SentenceParser, did_you_mean

if TYPE_CHECKING:
    from evaluator.commands.base import Commands


class Parser(SentenceParser):
    """The parser of this command line."""

    usage_error = UsageError


def main(argv: Sequence[str] | None = None, begin: Callable[[], None] = lambda: None) -> int:
    """Run the command line; returns the exit code.

    Args:
        argv: Words of the command line; default: those of this process.
        begin: Called when the modules of the command are loaded, before it does anything.
    """
    from evaluator.commands.process import make_room  # noqa: PLC0415
    from evaluator.errors import InfrastructureError, StoreError  # noqa: PLC0415

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
    """The options of a command line; its `run` executes the command.

    Raises:
        UsageError: The command line is wrong, or the study file that it names cannot be used.
        SystemExit: The command line asks for help or the version.
    """
    from evaluator.commands.overview import COMMANDS  # noqa: PLC0415
    from evaluator.study.config import with_config, with_new_names  # noqa: PLC0415

    words = list(argv)
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
    """The command line as far as a command needs it, and the parsers of its commands by name.

    Args:
        command: Name of a command, of which alone the module is loaded. With any other word the commands have no
            options, which is enough to list them.

    Raises:
        UsageError: The command belongs to a plugin that is not installed.
    """
    from evaluator.commands.overview import COMMANDS, DESCRIPTION  # noqa: PLC0415

    program = Parser("physment-eval", description=DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter)
    program.add_argument("--version", action="version", version=f"physment-eval {version('physment-mcp')}")
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
    from evaluator.commands.overview import COMMANDS_GROUP, plugin  # noqa: PLC0415

    plugin(COMMANDS_GROUP, command, command)(commands.add_parser(command))


def _note(sentence: str) -> None:
    print(f"physment-eval: {sentence}", file=sys.stderr)


def _fail(sentence: str, code: int) -> int:
    print(f"physment-eval: {sentence}", file=sys.stderr)
    return code
