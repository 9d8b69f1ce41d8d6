"""Detects leaks in results and refusals: words and numbers of a scene that are private at this moment.

Words in the server's code or in the opening prompt may occur by chance and are not searched for. Nor are numbers that
instruments could show. Instruments round, so many drawn values have more decimals than a reading.
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
"""Least number of significant digits of a number that is searched for."""
_NAMES_INSIDE = (r"created:\w", r"attached:\d", r"unnamed_[a-z]+_\d")
"""Names that the server gives to parts of the model."""
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
_ECHO = re.compile(r"of \S+ (?:N|N·m|kg) is too|step: \S+ s is")
"""Numbers in refusals that follow from the arguments of the call."""


@dataclass(frozen=True, slots=True)
class Private:
    """The private words and numbers of an episode; some only while its hidden objects are."""

    words: re.Pattern[str]
    numbers: frozenset[str]
    hidden_words: re.Pattern[str]
    hidden_numbers: frozenset[str]

    def leak(self, session: Session, text: str, call: Call) -> str:
        """The private word or number that a text contains and its call does not explain; empty if there is none.

        Args:
            session: The episode after the call, which tells what is still hidden.
            text: The refusal, or the result as JSON.
            call: The call; what it says itself is no leak where it is quoted.
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
    """What is private in a new episode of the suite.

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
    """The names that cannot stand in a text by chance."""
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
    """Finds each word as a whole word, and each pattern anywhere; nothing if there are none."""
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
    """The spellings of the numbers that no instrument can show, because they have more decimals than it reads."""
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
    """The numbers in values, however they are nested."""
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
    """How a text could show numbers: in full, or with six digits; without their sign.

    A spelling with fewer digits, as `12.85` of 12.850003, is left out: the clock, for example, may show it by chance.
    """
    sizes = [abs(value) for value in values]
    spelled = {spelling for size in sizes for spelling in (repr(size), f"{size:.6g}")}
    return {one for one in spelled if len(one.replace(".", "").lstrip("0").rstrip("0").split("e")[0]) >= _DIGITS}


def _quoted(call: Call) -> Iterator[str]:
    """How a refusal or a result repeats texts of the call."""
    texts = [call.tool, *call.arguments, *(value for value in call.arguments.values() if isinstance(value, str | int))]
    for text in map(str, texts):
        for length in (len(text), 64, 40):
            yield repr(text[:length])
            yield json.dumps(text[:length])
