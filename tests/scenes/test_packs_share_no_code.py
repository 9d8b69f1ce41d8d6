"""Tests that packs share no code: common code belongs in the library of protocols."""

import ast
import itertools
import re
from collections import Counter, defaultdict

from scenes import list_packs

MOST_SHARED_LINES = 19
STATEMENTS = 4
"""Least number of statements of a function that packs must not share."""
WORDS = 3
"""Least number of words of a line that counts as shared; `else:` or `calls = []` occur in any Python code."""
INTERFACE = re.compile(r"def (solve|theory|measure|structure|fit|predict|naive|batch|stage\w*)\(")

LINES_STILL_SHARED: set[tuple[int, int]] = set()
"""Pairs of scenes that still share lines. Remove a pair once its code is separated; never add one."""
FUNCTIONS_STILL_SHARED: set[tuple[int, int]] = set()


def _meaningful(source: str) -> Counter[str]:
    """Return the lines of a solution, without imports, docstrings, comments, short lines and required signatures."""
    left_out = set[int]()
    for node in ast.walk(ast.parse(source)):
        text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
        if text or isinstance(node, ast.Import | ast.ImportFrom):
            assert isinstance(node, ast.stmt)
            left_out |= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines = (line for number, line in enumerate(source.splitlines(), 1) if number not in left_out)
    bare = (line.split("  #")[0].strip() for line in lines)
    return Counter(line for line in bare if len(re.findall(r"\w+", line)) >= WORDS and not INTERFACE.match(line))


def _functions(source: str) -> set[str]:
    """Return the source of each longer function: its arguments and its body, without its name and docstring."""
    found = set[str]()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef):
            body = node.body[1:] if ast.get_docstring(node) is not None else node.body
            inner = [part for statement in body for part in ast.walk(statement) if isinstance(part, ast.stmt)]
            if len(inner) >= STATEMENTS:
                found.add("\n".join([ast.unparse(node.args), *map(ast.unparse, body)]))
    return found


def _sources() -> dict[int, str]:
    return {files.scene_id: files.solution.read_text(encoding="utf-8") for files in list_packs()}


def _pairs_with_many_lines(sources: dict[int, str]) -> set[tuple[int, int]]:
    lines = {number: _meaningful(source) for number, source in sources.items()}
    pairs = itertools.combinations(sorted(lines), 2)
    return {pair for pair in pairs if (lines[pair[0]] & lines[pair[1]]).total() > MOST_SHARED_LINES}


def _pairs_with_functions(sources: dict[int, str]) -> set[tuple[int, int]]:
    places: defaultdict[str, list[int]] = defaultdict(list)
    for number in sorted(sources):
        for function in _functions(sources[number]):
            places[function].append(number)
    return {pair for numbers in places.values() for pair in itertools.combinations(numbers, 2)}


def test_no_two_packs_share_twenty_lines() -> None:
    found = _pairs_with_many_lines(_sources())
    assert found <= LINES_STILL_SHARED, f"share a module of scenes/: {sorted(found - LINES_STILL_SHARED)}"
    assert found >= LINES_STILL_SHARED, f"take out of the list: {sorted(LINES_STILL_SHARED - found)}"


def test_no_two_packs_hold_the_same_function() -> None:
    found = _pairs_with_functions(_sources())
    assert found <= FUNCTIONS_STILL_SHARED, (
        f"move it into a module of scenes/: {sorted(found - FUNCTIONS_STILL_SHARED)}"
    )
    assert found >= FUNCTIONS_STILL_SHARED, f"take out of the list: {sorted(FUNCTIONS_STILL_SHARED - found)}"


def test_shared_lines_and_functions_are_counted() -> None:
    body = "".join(f"    part_{number} = knobs['a'] + {number}\n" for number in range(MOST_SHARED_LINES + 1))
    source = f'"""Scene."""\n\nimport numpy as np\n\n\ndef theory(knobs):\n    """Words, many words of it."""\n{body}'
    shorter = source.replace(body.splitlines(keepends=True)[0], "    part_0 = 0\n")
    assert _pairs_with_many_lines({1: source, 2: source + "\n\nelse_part = 1\n", 3: shorter}) == {(1, 2)}
    assert _pairs_with_functions({1: source, 2: source.replace("Words", "Others"), 3: shorter}) == {(1, 2)}
    assert _meaningful("import a.b.c.d\n'''one two three\nfour five six'''\nelse_ = 1\na = b + c  # d e f\n") == {
        "a = b + c": 1
    }
