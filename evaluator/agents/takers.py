"""Synthetic test takers: the reference agent with handicaps of known relative strength, to calibrate and test scenes.

A taker modifies the calls and readings between a reference protocol and the laboratory: it omits calls, adds noise to
readings, passes wrong arguments, or ignores some of the laws that the task lists. The protocol itself is not changed.
The random numbers of an episode depend only on its scene, seed and epoch, so a stronger handicap of the same kind
includes the weaker one.
"""

import itertools
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from evaluator.agents.reference import ProtocolPlayer, ReferenceAgent, reading_of
from evaluator.episode.player import ANSWER, Briefing, Feedback, Reply
from evaluator.errors import AgentError, UsageError
from evaluator.records.episode import EpisodeKey, Exchange, ToolCall
from scenes import find_pack, read_pack
from scenes.protocol import Call, Member, Reading, load_solution

TAKER = "taker:"
_SHARE = 0.01
"""Standard deviation of the added noise at `noise-1`, relative to the reading, if the scene states no noise."""
_WRONG = 0.5
"""Factor of the numbers in a call with a slip. It is below 1, so that such a call exceeds no limit of the scene."""
_READS = ("get_", "compute_", "detect_", "find_")
"""Prefixes of the names of reading tools, whose results get noise and whose calls get no slips."""
_INSTRUMENTS = {"position": "position", "velocity": "velocity", "angle": "angle", "angular_velocity": "spin"}
"""Field of a result → name of the instrument that reads it."""
_ROUNDS = 300
"""Number of consecutive batches without a call of the taker after which the protocol counts as failed."""
LAWS = ("unknown-1", "unknown-2", "no-check", "wrong-law")
"""Handicaps that restrict which members of the stated family of laws a taker considers, weakest first."""


@dataclass(frozen=True, slots=True)
class Handicap:
    """Handicap of a taker in comparison with the reference agent. By default there is none."""

    calls: float = float("inf")
    """Number of calls that the taker makes before its answer; readings of further calls are missing."""
    noise: float = 0.0
    """Standard deviation of the noise added to readings: in units of the noise that the scene states for the
    instrument, or in per cent of the reading where it states none."""
    slips: float = 0.0
    """Percentage of the acting or waiting calls in which the numbers are half of the intended ones."""
    law: str = ""
    """Entry of `LAWS`; it has an effect only in packs with a family of laws. The taker does not know one or two of the
    laws, knows only one law, or knows all laws except the best-fitting one. Empty if it knows all laws."""

    def is_within(self, other: "Handicap") -> bool:
        """Return whether this handicap is at most as strong as another one in every respect."""
        law = ("", *LAWS).index
        return (
            self.calls >= other.calls
            and self.noise <= other.noise
            and self.slips <= other.slips
            and law(self.law) <= law(other.law)
        )


TAKERS = (
    "none",
    *("calls-100", "calls-60", "calls-40", "calls-24", "calls-12", "calls-6", "calls-3"),
    *("noise-0.5", "noise-1", "noise-2", "noise-4", "noise-8", "noise-16", "noise-50"),
    *("slips-1", "slips-3", "slips-10", "slips-30"),
    *LAWS,
    *("calls-100+noise-1", "calls-60+noise-2", "calls-40+noise-4", "calls-24+noise-8"),
    *("noise-1+unknown-1", "noise-2+unknown-2", "noise-4+no-check"),
)
"""The takers of a calibration, by the name after `taker:`. Their handicaps are partially ordered by `is_within`."""


def parse_handicap(text: str) -> Handicap:
    """Read the name of a taker, such as `noise-3`, `calls-40+slips-10`, `wrong-law` or `none`.

    Raises:
        UsageError: There is no such handicap.
    """
    found: dict[str, Any] = {}
    for part in () if text == "none" else text.split("+"):
        kind, _, size = part.partition("-")
        if part in LAWS:
            found["law"] = part
        elif kind in {"calls", "noise", "slips"} and size.replace(".", "", 1).isdecimal():
            found[kind] = float(size)
        else:
            raise UsageError(
                f"--agent {TAKER}{text}: there is no handicap {part!r}; a taker is none, or calls-N, noise-N, slips-N,"
                f" {', '.join(LAWS)} joined by +"
            )
    return Handicap(**found)


@dataclass(frozen=True, slots=True)
class TakerAgent:
    """Plays the reference protocols under a handicap."""

    taker: str
    """Name of the handicap; see `parse_handicap`."""
    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""

    def __post_init__(self) -> None:
        parse_handicap(self.taker)

    @property
    def name(self) -> str:
        """`taker:` and the name of the handicap."""
        return f"{TAKER}{self.taker}"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_TakerPlayer":
        """Start the reference protocol of the scene.

        Raises:
            AgentError: The pack has no protocol.
        """
        inner = ReferenceAgent(self.scenes_dir).player(key, briefing)
        files = find_pack(key.scene, self.scenes_dir)
        instruments, rivals = read_pack(files).instruments, load_solution(files).rivals
        noise = instruments.noise.model_dump() if instruments and instruments.noise else {}
        salt = f"{key.scene}:{key.seed}:{key.epoch}"
        return _TakerPlayer(inner, parse_handicap(self.taker), noise, rivals, salt)


@dataclass(slots=True)
class _TakerPlayer:
    inner: ProtocolPlayer
    handicap: Handicap
    noise: Mapping[str, float]
    """Name of an instrument → standard deviation of its noise, as stated by the scene."""
    rivals: Callable[[Sequence[tuple[Call, Reading]]], Mapping[str, Member]] | None
    salt: str
    """Common prefix of the seeds of all random numbers of the episode."""
    made: int = 0
    """Number of calls made."""
    asked: int = 0
    """Number of calls that the protocol has requested."""
    reply: Reply | None = None
    """The latest reply of the protocol."""
    seen: list[tuple[Call, Reading]] = field(default_factory=list[tuple[Call, Reading]])
    """Calls as the protocol made them, with the readings that it received."""

    async def act(self, feedback: Feedback | None) -> Reply:
        """Return the calls of the protocol's next batch, without those that the handicap omits.

        Raises:
            AgentError: The protocol failed, or requested only omitted calls in many batches.
        """
        exchanges = feedback.exchanges if feedback else ()
        for _ in range(_ROUNDS):
            told = self._received(exchanges) if self.reply else None
            try:
                self.reply = await self.inner.act(told)
            except AgentError:
                if self.rivals is None or self.made < self.handicap.calls:
                    raise
                return Reply("The protocol needs more readings.", (self._fitted(ToolCall(tool=ANSWER, arguments={})),))
            calls = tuple(self._sent(self.reply.calls))
            if calls or not self.reply.calls:
                return replace(self.reply, calls=calls)
            exchanges = ()
        raise AgentError("the protocol cannot continue without the calls that were not made")

    def _sent(self, calls: Sequence[ToolCall]) -> Iterator[ToolCall]:
        """Yield the calls to make: some with wrong arguments, none over the limit; an answer uses the known laws."""
        for number, asked in enumerate(calls, self.asked):
            if asked.tool == ANSWER:
                yield self._fitted(asked) if self.handicap.law else asked
            elif self.made < self.handicap.calls:
                self.made += 1
                slips = not asked.tool.startswith(_READS) and self._source("slip", number) < self.handicap.slips / 100
                yield ToolCall(tool=asked.tool, arguments=_scaled(asked.arguments)) if slips else asked

    def _received(self, exchanges: Sequence[Exchange]) -> Feedback:
        """Return the readings of the latest batch for the protocol: distorted, and empty for omitted calls."""
        assert self.reply is not None
        told: list[Exchange] = []
        for asked, made in itertools.zip_longest(self.reply.calls, exchanges):
            exchange = Exchange(call=asked, returned=False)
            if made is not None:
                content = self._distorted(made.content, self.asked) if asked.tool.startswith(_READS) else made.content
                exchange = made.model_copy(update={"call": asked, "content": content})
            self.asked += 1
            told.append(exchange)
            self.seen.append((Call(asked.tool, dict(asked.arguments)), reading_of(exchange)))
        return Feedback(told, "", 0)

    def _distorted(self, content: dict[str, Any] | None, number: int) -> dict[str, Any] | None:
        """Add noise to every number of a reading except the clock."""
        if not content or not self.handicap.noise:
            return content
        source = random.Random(f"{self.salt}:noise:{number}")  # noqa: S311 - must be reproducible, not secret

        def noisy(value: Any, stated: float) -> Any:
            if isinstance(value, dict):
                return {name: noisy(part, stated) for name, part in cast("dict[str, Any]", value).items()}
            if isinstance(value, list):
                return [noisy(part, stated) for part in cast("list[Any]", value)]
            if isinstance(value, float):
                return value + self.handicap.noise * (stated or _SHARE * abs(value)) * source.gauss()
            return value

        return {
            name: value if name == "sim_time" else noisy(value, self.noise.get(_INSTRUMENTS.get(name, ""), 0.0))
            for name, value in content.items()
        }

    def _fitted(self, asked: ToolCall) -> ToolCall:
        """Return the `answer` call with the answer that follows from the best-fitting law that the taker knows.

        Without a family of laws in the pack, the call is returned unchanged. The law that the protocol inferred is
        removed from the call if the taker does not know it.
        """
        if self.rivals is None:
            return asked
        try:
            fits = self.rivals(self.seen)
        except Exception as error:
            raise AgentError(f"no law can be fitted: {error!r}") from error
        known = _known(sorted(fits, key=lambda name: self._source("law", name)), fits, self.handicap.law)
        best = min(known, key=lambda name: fits[name].chi_square)
        arguments = {**asked.arguments, "answer": cast("Any", fits[best].answer)}
        if best != min(fits, key=lambda name: fits[name].chi_square):
            arguments.pop("law", None)
        return ToolCall(tool=ANSWER, arguments=arguments)

    def _source(self, kind: str, which: object) -> float:
        """Return a reproducible random number between 0 and 1 for a call or a law."""
        return random.Random(f"{self.salt}:{kind}:{which}").random()  # noqa: S311 - must be reproducible, not secret


def _known(order: Sequence[str], fits: Mapping[str, Member], law: str) -> Sequence[str]:
    """Return the laws that a taker knows: all except the best-fitting one, or a random subset with at least one law."""
    if law == "wrong-law":
        best = min(order, key=lambda name: fits[name].chi_square)
        return [name for name in order if name != best] or order
    unknown = {"": 0, "unknown-1": 1, "unknown-2": 2}.get(law, len(order))
    return order[min(unknown, len(order) - 1) :]


def _scaled(value: Any) -> Any:
    """Return arguments in which every number is multiplied by `_WRONG`."""
    if isinstance(value, dict):
        return {name: _scaled(part) for name, part in cast("dict[str, Any]", value).items()}
    if isinstance(value, list):
        return [_scaled(part) for part in cast("list[Any]", value)]
    return value * _WRONG if isinstance(value, int | float) and not isinstance(value, bool) else value
