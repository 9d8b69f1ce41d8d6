"""Detects leaks in results and refusals: words and numbers of a scene that are private at the moment of the call.

Words of the server's code or of the opening prompt may occur by chance and are not searched for, nor are numbers that
instruments could show. Instruments round, so most hidden values have more decimals than any reading.
"""

import functools
import json
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import physment_mcp
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from scenes import Pack, draw_knobs, find_pack, read_pack
from scenes.protocol import Call

_SHORTEST_WORD = 4
_DIGITS = 6
"""Least number of significant digits that a number must have to be searched for."""
_NAMES_INSIDE = (r"created:\w", r"attached:\d", r"unnamed_[a-z]+_\d")
"""Names that the server gives to parts of the model."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_ECHO = re.compile(r"of \S+ (?:N|N·m|kg) is too|step: \S+ s is")
"""Numbers in refusals that follow from the arguments of the call."""


@dataclass(frozen=True, slots=True)
class Private:
    """The private words and numbers of an episode; some are private only while their objects are hidden."""

    words: re.Pattern[str]
    numbers: frozenset[str]
    hidden_words: re.Pattern[str]
    hidden_numbers: frozenset[str]

    def leak(self, session: Session, text: str, call: Call) -> str:
        """Return the private word or number that a text contains without repeating the call; empty if there is none.

        Args:
            session: The episode after the call, for the objects that are still hidden.
            text: The refusal, or the result as JSON.
            call: The call; quoting it is no leak.
        """
        hidden = any(not item.known for item in session.state.objects.values())
        for quoted in sorted(set(_quoted(call)), key=len, reverse=True):
            text = text.replace(quoted, "")
        found = self.words.search(text) or (self.hidden_words.search(text) if hidden else None)
        if found:
            return found[0]
        private = self.numbers | self.hidden_numbers if hidden else self.numbers
        tokens = _NUMBER.findall(_ECHO.sub("", text))
        return next((token for token in tokens if token.lstrip("-") in private), "")


def private_of(session: Session, seed: int) -> Private:
    """Collect the private words and numbers of a new episode.

    Args:
        session: The episode, before its first call.
        seed: The seed of its scene.
    """
    files = find_pack(session.scene.public.scene_id, None)
    pack = read_pack(files)
    prompt = opening_prompt(session)
    knobs = draw_knobs(files, pack, seed)
    drawn = [*_numbers(knobs.values()), *_numbers([pack.answer if seed == 0 else ()]), *_withheld(session)]
    hidden = [item for item in session.state.objects.values() if not item.known]
    found_later = list(_numbers(session.describe(item) for item in hidden))
    shown = set(_NUMBER.findall(prompt)) | _spellings(_numbers([look for _, look in session.opening]))
    words = [item.object_id for item in hidden] + _unusual((item.name for item in hidden), prompt)
    return Private(
        _pattern(_private_words(session, pack, [*pack.knobs, *pack.derive], prompt), _NAMES_INSIDE),
        frozenset(_searched(session, drawn) - shown - _spellings(found_later)),
        _pattern(words),
        frozenset(_searched(session, found_later) - shown),
    )


def _private_words(session: Session, pack: Pack, names: Iterable[str], prompt: str) -> list[str]:
    """Names of knobs and of everything in the model, and the private texts of the pack."""
    objects = {item.object_id for item in session.state.objects.values()}
    named = {*names, *re.findall(r'\bname="([^"]+)"', session.scene.mjcf)} - objects
    texts = (pack.canary, pack.reasoning, pack.expected_behavior, pack.metadata.description)
    return [*_unusual(named, prompt), *(text for text in texts if text and text not in prompt)]


def _unusual(names: Iterable[str], prompt: str) -> list[str]:
    """Return the names that cannot occur in a text by chance."""
    public = _words_of_the_server() | set(re.findall(r"\w+", prompt))
    return sorted(
        name for name in set(names) if len(name) >= _SHORTEST_WORD and not set(re.findall(r"\w+", name)) <= public
    )


@functools.cache
def _words_of_the_server() -> frozenset[str]:
    folder = Path(str(physment_mcp.__file__)).parent
    return frozenset(
        word for path in folder.rglob("*.py") for word in re.findall(r"\w+", path.read_text(encoding="utf-8"))
    )


def _pattern(words: Sequence[str], patterns: Sequence[str] = ()) -> re.Pattern[str]:
    """Compile a pattern that finds each word as a whole word and each given pattern anywhere; without any, it never
    matches.
    """
    whole = [rf"(?<!\w){re.escape(word)}(?!\w)" for word in words]
    return re.compile("|".join([*whole, *patterns]) or r"(?!)")


def _withheld(session: Session) -> list[float]:
    """The numbers about objects that the agent may not read, hidden objects included."""
    world = session.world
    found: list[object] = []
    for item in session.state.objects.values():
        shape = world.shape(item.body)
        if not session.may_read(item, "mass"):
            found += [world.mass(item.body), world.density(item.body)]
        if not session.may_read(item, "size"):
            found += [shape.box, shape.radius]
        if not session.may_read(item, "position"):
            found.append(item.start)
    return list(_numbers(found))


def _searched(session: Session, values: Iterable[float]) -> set[str]:
    """Return the spellings of the numbers that have more decimals than any instrument shows."""
    said = session.scene.public.instruments
    if said is None:
        return set()
    steps = [step for step in (said.position, said.velocity, said.angle, said.spin) if step > 0]
    return _spellings(
        value
        for value in values
        if not any(math.isclose(value, round(value / step) * step, rel_tol=1e-9) for step in steps)
    )


def _numbers(values: Iterable[object]) -> Iterator[float]:
    """Return all numbers in nested values."""
    for value in values:
        if isinstance(value, bool | str) or value is None:
            continue
        if isinstance(value, int | float):
            yield float(value)
        elif isinstance(value, dict):
            yield from _numbers(cast("dict[str, object]", value).values())
        else:
            yield from _numbers(item.item() if hasattr(item, "item") else item for item in cast("Any", value))


def _spellings(values: Iterable[float]) -> set[str]:
    """Return the spellings by which a text could show numbers: in full or with six digits, without sign.

    Shorter spellings, such as `12.85` for 12.850003, are omitted, because other values, such as the clock, may have
    them by chance.
    """
    sizes = [abs(value) for value in values]
    spelled = {spelling for size in sizes for spelling in (repr(size), f"{size:.6g}")}
    return {one for one in spelled if len(one.replace(".", "").lstrip("0").rstrip("0").split("e")[0]) >= _DIGITS}


def _quoted(call: Call) -> Iterator[str]:
    """Return the spellings in which a refusal or a result could quote strings of the call."""
    texts = [call.tool, *call.arguments, *(value for value in call.arguments.values() if isinstance(value, str | int))]
    for text in map(str, texts):
        for length in (len(text), 64, 40):
            yield repr(text[:length])
            yield json.dumps(text[:length])
