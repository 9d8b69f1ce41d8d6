"""Counts the steps of a backtracking search for a regular expression: its work, on every machine the same.

`re` searches in one call and does not report its work. So the parsed pattern is matched again here, in the order in
which `re` tries, one step at a time. Back references and conditional groups are not supported.
"""

import importlib
import re
import sys
from collections.abc import Callable, Sequence
from typing import Any

_parser: Any = importlib.import_module("re._parser")
_compiler: Any = importlib.import_module("re._compiler")

Node = tuple[Any, Any]
"""A part of a parsed pattern: operation and argument."""
Nodes = Sequence[Node]
Rest = Callable[[int], bool]
"""Whether the rest of a pattern matches from a place on."""

_FRAMES = 100_000
"""Recursion limit while a text is searched: each character that is repeated takes a few frames."""


def search_steps(pattern: re.Pattern[str], text: str) -> tuple[int, list[tuple[int, int]]]:
    """The number of steps that it takes to find all matches in a text, and where they are, as `finditer` does."""
    search = _Search(text, pattern.flags)
    nodes = _parser.parse(pattern.pattern, pattern.flags)
    found: list[tuple[int, int]] = []
    at, shortest = 0, 0
    while at <= len(text):
        end = search.first_end(nodes, at, shortest)
        if end is None:
            at, shortest = at + 1, 0
            continue
        found.append((at, end))
        # After an empty match, the next one at the same place may not be empty.
        at, shortest = end, int(end == at)
    return search.steps, found


def match_steps(pattern: re.Pattern[str], text: str) -> int:
    """The number of steps that it takes to match a whole text, or to find that it does not match."""
    search = _Search(text, pattern.flags)
    search.first_end(_parser.parse(pattern.pattern, pattern.flags), 0, len(text))
    return search.steps


class _Search:
    def __init__(self, text: str, flags: int) -> None:
        self.steps = 0
        self._text = text
        self._flags = flags
        self._testers: dict[str, re.Pattern[str]] = {}
        self._ways: dict[str, Callable[[Any, int, Rest], bool]] = {
            "SUBPATTERN": lambda argument, at, rest: self._match(argument[-1], 0, at, rest),
            "BRANCH": lambda argument, at, rest: any(self._match(branch, 0, at, rest) for branch in argument[1]),
            "ATOMIC_GROUP": lambda body, at, rest: self._go_on(self.first_end(body, at), rest),
            "POSSESSIVE_REPEAT": lambda repeat, at, rest: self._go_on(self._longest(repeat, at), rest),
            "ASSERT": lambda argument, at, rest: self._looks(argument, at) and rest(at),
            "ASSERT_NOT": lambda argument, at, rest: not self._looks(argument, at) and rest(at),
            "MAX_REPEAT": lambda repeat, at, rest: self._repeat(repeat, at, rest, lazy=False),
            "MIN_REPEAT": lambda repeat, at, rest: self._repeat(repeat, at, rest, lazy=True),
        }

    def first_end(self, nodes: Nodes, at: int, shortest: int = 0) -> int | None:
        """Where the first match from a place ends that is not shorter; None if there is none."""
        ends: list[int] = []

        def accept(end: int) -> bool:
            if end - at < shortest:
                return False
            ends.append(end)
            return True

        limit = sys.getrecursionlimit()
        sys.setrecursionlimit(_FRAMES)
        try:
            self._match(nodes, 0, at, accept)
        finally:
            sys.setrecursionlimit(limit)
        return ends[0] if ends else None

    def _match(self, nodes: Nodes, index: int, at: int, then: Rest) -> bool:
        self.steps += 1
        if index == len(nodes):
            return then(at)
        operation, argument = nodes[index]
        name = str(operation)

        def rest(end: int) -> bool:
            return self._match(nodes, index + 1, end, then)

        if name in {"LITERAL", "NOT_LITERAL", "ANY", "IN", "AT"}:
            return self._fits(nodes[index], at) and rest(at + (name != "AT"))
        return self._ways[name](argument, at, rest)

    def _fits(self, node: Node, at: int) -> bool:
        """Whether one character or position is as a node asks."""
        key = repr(node)
        if key not in self._testers:
            state = _parser.State()
            state.flags, state.str = self._flags, ""
            self._testers[key] = _compiler.compile(_parser.SubPattern(state, [node]), self._flags)
        return self._testers[key].match(self._text, at) is not None

    def _go_on(self, end: int | None, rest: Rest) -> bool:
        return end is not None and rest(end)

    def _looks(self, argument: tuple[int, Any], at: int) -> bool:
        """Whether a pattern matches after a place, or before it."""
        direction, nodes = argument
        start = at if direction > 0 else at - nodes.getwidth()[0]
        return start >= 0 and self.first_end(nodes, start) is not None

    def _longest(self, repeat: tuple[int, int, Nodes], at: int) -> int | None:
        """Where a repetition ends that gives nothing back; None if it is too short."""
        (least, most, body), count = repeat, 0
        while count < most and (end := self.first_end(body, at)) is not None:
            count += 1
            if end == at:
                return at
            at = end
        return at if count >= least else None

    def _repeat(self, repeat: tuple[int, int, Nodes], at: int, rest: Rest, *, lazy: bool) -> bool:
        least, most, body = repeat

        def again(end: int) -> bool:
            # A round that matches nothing would do so for ever.
            return (end > at or least > 0) and self._repeat((max(least - 1, 0), most - 1, body), end, rest, lazy=lazy)

        def more() -> bool:
            return most > 0 and self._match(body, 0, at, again)

        if least > 0:
            return more()
        return (rest(at) or more()) if lazy else (more() or rest(at))
