"""`--config study.toml`: the options of a run, kept in a file."""

import tomllib
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from evaluator.errors import UsageError

Scalar = str | int | float | bool


def with_config(words: Sequence[str], options: Collection[str]) -> list[str]:
    """Put the options of the file that `--config` names before those of the command line, which so win.

    A key is a long option without its dashes (`max-cost` or `max_cost`). A list is joined by commas, but for `agent`,
    which is given once for each; `true` gives an option that takes no value.

    Args:
        words: Words of the command line, `--config FILE` among them or not.
        options: The long options there are, with their dashes.

    Raises:
        UsageError: The file cannot be read, or has a key that is no option.
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
    given = {word.partition("=")[0] for word in rest[:end]}
    said: list[str] = []
    for key, content in _read(file).items():
        option = f"--{key.replace('_', '-')}"
        if option not in options or option == "--config":
            raise UsageError(f"{file}: there is no option {key!r}; see physment-eval run --help")
        # An option that may be repeated would be added to, not replaced.
        if option not in given:
            said += _words(option, content, file)
    return said + rest


def _read(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--config {file}: cannot be read ({error})") from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"--config {file}: is not TOML: {error}") from error


def _words(option: str, content: Any, file: Path) -> list[str]:
    if content is True:
        return [option]
    if content is False:
        return []
    if isinstance(content, list) and option == "--agent":
        return [word for one in content for word in (option, str(one))]  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - TOML
    if isinstance(content, list):
        return [f"{option}={','.join(map(str, content))}"]  # pyright: ignore[reportUnknownArgumentType] - TOML
    if isinstance(content, Scalar):
        return [f"{option}={content}"]
    raise UsageError(f"{file}: {option.removeprefix('--')} must be a value or a list")
