"""Benchmarks of parsing text written by agents."""

import time
from collections.abc import AsyncGenerator, Callable

from evaluator.episode.protocols.text import parse_reply
from evaluator.quantities.spoken import spoken_numbers
from tests.harness.bench.measuring import Row, Timed, compare

Reader = Callable[[str], object]


def numbers_stated(text: str) -> int:
    """Count the numbers that a text states."""
    return sum(1 for _ in spoken_numbers(text))


READERS: dict[Reader, tuple[str, ...]] = {
    parse_reply: ('[{"tool":"a"},', '{"a": /* }', "[{'a", "```json {'tool':x} ```"),
    numbers_stated: ("1 ", "(1,", "1 m/s/s*"),
}


async def rows() -> AsyncGenerator[Row]:
    """Parse adversarial texts, which are slow to parse, and compare the time for a text with that for half of it.

    A test checks that the number of function calls grows linearly; it does not measure the time inside C functions.
    """
    for read, pieces in READERS.items():
        for piece in pieces:

            def reading(length: int, read: Reader = read, piece: str = piece) -> Timed:
                text = piece * (length // len(piece))

                async def timed() -> float:
                    start = time.process_time()
                    read(text)
                    return time.process_time() - start

                return timed

            yield await compare(f"{read.__name__}, twice {piece!r}", reading(20_000), reading(10_000), 9, 2.3)
