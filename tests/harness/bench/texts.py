"""Times of reading what an agent wrote."""

import time
from collections.abc import AsyncGenerator, Callable

from evaluator.episode.protocols.text import parse_reply
from evaluator.quantities.spoken import spoken_numbers
from tests.harness.bench.measuring import Row, Timed, compare

Reader = Callable[[str], object]


def numbers_stated(text: str) -> int:
    """How many numbers a text states."""
    return sum(1 for _ in spoken_numbers(text))


READERS: dict[Reader, tuple[str, ...]] = {
    parse_reply: ('[{"tool":"a"},', '{"a": /* }', "[{'a", "```json {'tool':x} ```"),
    numbers_stated: ("1 ", "(1,", "1 m/s/s*"),
}


async def rows() -> AsyncGenerator[Row]:
    """Texts made to hold up whoever reads what an agent wrote: one of twice the length, against one of the length.

    That the counted work grows in proportion to the length is a test; it does not see what one call into C costs.
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
