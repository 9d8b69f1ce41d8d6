"""One episode, from the opening of its session to its record; played anew if the infrastructure fails."""

from collections.abc import Awaitable, Callable
from datetime import UTC, datetime

import anyio

from evaluator.episode.connect import Laboratory
from evaluator.episode.contender import Contender
from evaluator.errors import InfrastructureError, PermanentFailure
from evaluator.records import Episode, EpisodeKey, Outcome, Usage, Versions, total_usage

MAX_ATTEMPTS = 3
"""How often an episode is opened before its infrastructure error is recorded."""
_PAUSE_S = 0.5
"""Pause before the second attempt [s]; doubled for each further one."""

Play = Callable[[Contender, Laboratory, EpisodeKey, Versions, float | None], Awaitable[Episode]]
"""What plays an episode: `play_key` in this process, or something that has it called in another."""


async def play_key(
    contender: Contender, laboratory: Laboratory, key: EpisodeKey, versions: Versions, timeout_s: float | None = None
) -> Episode:
    """Play an episode until it has an outcome, or the attempts are used up.

    Args:
        contender: Who plays.
        laboratory: Where.
        key: Which episode.
        versions: Recorded with it.
        timeout_s: Wall time of one attempt [s]; None for no limit. Running out of it is an infrastructure error.

    Raises:
        UsageError: The laboratory does not fit the contender.
        PermanentFailure: No episode of this contender can be played.
    """
    failure, used = "", list[Usage]()
    for attempt in range(1, MAX_ATTEMPTS + 1):
        if attempt > 1:
            await anyio.sleep(_PAUSE_S * 2 ** (attempt - 2))
        try:
            with anyio.move_on_after(timeout_s):
                episode = await contender.play(laboratory, key, versions, used)
                return episode.model_copy(update={"attempts": attempt})
            failure = f"the episode took longer than {timeout_s} s"
        except PermanentFailure:
            raise
        except InfrastructureError as error:
            failure = str(error)
    return unplayed(key, failure, versions, total_usage(used))


def unplayed(key: EpisodeKey, failure: str, versions: Versions, usage: Usage | None = None) -> Episode:
    """The record of an episode that only infrastructure errors ended.

    Args:
        key: Which episode.
        failure: What went wrong last, as a sentence.
        versions: Recorded with it.
        usage: What the attempts used, where that is known.
    """
    return Episode(
        key=key,
        outcome=Outcome.INFRASTRUCTURE_ERROR,
        prompt="",
        turns=(),
        error=failure,
        attempts=MAX_ATTEMPTS,
        usage=usage,
        started_at=datetime.now(UTC).isoformat(timespec="milliseconds"),
        duration_s=0.0,
        versions=versions,
    )
