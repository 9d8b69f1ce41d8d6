"""`--config study.toml`: the options of a run, from a file."""

import tomllib
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any

from evaluator.errors import UsageError, reason_of

Scalar = str | int | float | bool


RENAMED = {"--trust-edited": "--allow-modified", "--home-from": "--home-template"}
"""Options of version 0.1 → their names since 0.2. Version 0.3 will not know the old ones."""


def with_new_names(words: Sequence[str], note: Callable[[str], None]) -> list[str]:
    """Replace old names of options, up to the words after `--`; `note` gets a sentence for each."""
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
        # Skip options of the command line: an option that may be repeated would get both values.
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
