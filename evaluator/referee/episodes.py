"""The episodes of a referee: opened on an episode server, read back from its call log, and graded once.

This module uses servers, answer keys and records; `evaluator.referee.requests` provides the HTTP endpoints.
"""

import contextlib
import functools
import secrets
import time
from collections import OrderedDict
from collections.abc import AsyncGenerator, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import anyio.to_thread

from evaluator.agents.external.watched import WatchedEpisode, outcome_of, watch_episode
from evaluator.agents.reference import ReferenceAgent
from evaluator.answers.keys import KeyRing
from evaluator.answers.rewards import AnswerReward, RewardRule, answer_reward
from evaluator.certify.seed_proofs import SeedProver
from evaluator.episode.hosts import HostConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing
from evaluator.errors import InfrastructureError, RefusedRequest, ServerFull
from evaluator.records.episode import Episode, EpisodeKey, Grade, Outcome, Verdict, timestamp
from evaluator.records.run import RunRecord
from evaluator.referee.contract import EndedEpisode, OpenedEpisode, Reward, Variant, WantedEpisode, WantedVariants
from evaluator.referee.recording import Metrics, Recording
from evaluator.referee.selection import proved_variant
from evaluator.referee.shaping import shaping_of
from evaluator.referee.variants import VariantPage, Variants
from evaluator.scores.scoring import grade_record
from evaluator.store.run_folder import RunFolder

T = TypeVar("T")

_REMEMBERED = 10_000
"""Number of graded episodes whose ids are kept, to refuse a second request for their reward."""
_GONE = "there is no such episode: it was closed, has expired, or never was; open one with POST /episodes"


@dataclass(slots=True)
class _Watched:
    """An open episode that is not graded yet."""

    key: EpisodeKey
    variant: Variant
    max_calls: int
    owner_token: str
    prompt: str
    watched: WatchedEpisode
    closing: contextlib.AsyncExitStack
    """Closes the episode on the server."""
    opened_at: float
    """Time of opening on the monotonic clock [s]."""
    started_at: str
    asked: bool = False
    """Whether the episode is being graded now."""


@dataclass(slots=True)
class Referee:
    """Opens episodes on one episode server and grades them."""

    host: HostConnector
    keys: KeyRing
    record: RunRecord
    """Run record, with the versions of episodes and the single agent name under which they are recorded."""
    rule: RewardRule = field(default_factory=RewardRule)
    prover: SeedProver | None = None
    """Checks seeds that no certificate covers before they are opened; None to open every seed unchecked."""
    shapes: bool = False
    """Whether rewards include a shaping reward for each call."""
    folder: RunFolder | None = None
    """Run folder that records the episodes; None to record nothing."""
    max_episodes: int = 1000
    max_wall_s: float = 3600.0
    """Wall time after which an ungraded episode is closed [s]."""
    difficulties: Mapping[int, tuple[float, float]] = field(default_factory=dict[int, tuple[float, float]])
    """Scene → its calibrated difficulty and the standard error [logits]."""
    variants: Variants = field(init=False)
    metrics: Metrics = field(default_factory=Metrics)
    recording: Recording = field(default_factory=Recording)
    _open: dict[str, _Watched] = field(default_factory=dict[str, _Watched])
    _opening: int = 0
    _graded: OrderedDict[str, str] = field(default_factory=OrderedDict[str, str])
    """Id → owner token of the most recently graded episodes."""
    _grading: anyio.CapacityLimiter = field(default_factory=lambda: anyio.CapacityLimiter(1))
    """Limits grading to one thread, because a key may need the engine and records are appended to a file."""

    def __post_init__(self) -> None:
        """Create the `Variants` object, which selects variants and provides their answer keys."""
        self.variants = Variants(self.keys, self.record, self.difficulties)

    async def listed(self, wanted: WantedVariants) -> VariantPage:
        """Return public properties of the scenes of a split, or of its worlds.

        Raises:
            RefusedRequest: There is no such split, or no such world.
        """
        return await self._in_thread(functools.partial(self.variants.listed, wanted))

    @property
    def open_episodes(self) -> int:
        """Number of episodes that are open or being opened."""
        return len(self._open) + self._opening

    async def open(self, wanted: WantedEpisode, count: int = 1, curriculum: str | None = None) -> list[OpenedEpisode]:
        """Open several episodes of one variant on the server; either all are opened or none.

        Args:
            wanted: The variant.
            count: Number of episodes.
            curriculum: Name of the curriculum that chooses the variant and counts the rewards; None for none.

        Raises:
            RefusedRequest: There is no such variant, it has no key, or too many episodes are open.
            InfrastructureError: The server failed.
        """
        async with self._places(count), contextlib.AsyncExitStack() as closing:
            variant, key = await self._selected(wanted, self.record.plan.agents[0], curriculum)
            episodes: list[_Watched] = []
            briefing: Briefing | None = None
            for _ in range(count):
                episode, briefing = await self._open_one(variant, key, wanted.max_calls, briefing)
                closing.push_async_callback(episode.closing.aclose)
                episodes.append(episode)
            closing.pop_all()
            assert briefing is not None
            self.metrics.opened += count
            return [self._register(variant, episode, briefing) for episode in episodes]

    async def _selected(
        self, wanted: WantedEpisode, agent: str, curriculum: str | None = None
    ) -> tuple[Variant, EpisodeKey]:
        """Return the variant to open, with the key under which its episode is recorded.

        Raises:
            RefusedRequest: There is no such variant, its seed fails the checks, or it has no answer key.
        """
        variant = await self._in_thread(functools.partial(self.variants.select, wanted, curriculum))
        if self.prover is not None:
            variant = await proved_variant(self.prover, wanted, variant)
        return variant, await self._in_thread(functools.partial(self.variants.key, variant, wanted, agent))

    async def check(self, wanted: WantedEpisode) -> Reward:
        """Play one episode with the reference protocol of a scene, without recording it.

        Raises:
            RefusedRequest: As for `open`.
            InfrastructureError: The server failed.
        """
        async with self._places(1):
            agent = ReferenceAgent(self.keys.folder)
            _, key = await self._selected(wanted, agent.name)
            versions = self.record.versions_of(key.scene)
            async with self.host.open(key.scene, key.seed) as client:
                played = await play_episode(agent, client, key, versions, self.host.toolboxes)
            calls = sum(exchange.returned for turn in played.turns for exchange in turn.exchanges)
            return await self._reward(played, len(played.turns), calls)

    @contextlib.asynccontextmanager
    async def _places(self, count: int) -> AsyncGenerator[None]:
        """Reserve capacity within `max_episodes` while episodes are being opened.

        Raises:
            RefusedRequest: The limit of open episodes, here or on the server, would be exceeded.
        """
        if self.open_episodes + count > self.max_episodes:
            raise RefusedRequest(
                429,
                f"{self.open_episodes} episodes are open, and {self.max_episodes} is the limit: ask for rewards, or"
                " close some",
            )
        self._opening += count
        try:
            yield
        except ServerFull as error:
            raise RefusedRequest(429, str(error)) from error
        finally:
            self._opening -= count

    async def _open_one(
        self, variant: Variant, key: EpisodeKey, max_calls: int, briefing: Briefing | None
    ) -> tuple[_Watched, Briefing]:
        """Open an episode on the server; `briefing` is reused from another episode of the variant, if given."""
        started_at = timestamp()
        async with contextlib.AsyncExitStack() as stack:
            watched = await stack.enter_async_context(
                watch_episode(self.host, key.scene, key.seed, max_calls, guarded=True)
            )
            briefing = briefing or await watched.briefing(key, self.host.toolboxes)
            closing = stack.pop_all()
        episode = _Watched(
            key=key,
            variant=variant,
            max_calls=max_calls,
            owner_token=secrets.token_urlsafe(24),
            prompt=briefing.prompt,
            watched=watched,
            closing=closing,
            opened_at=time.monotonic(),
            started_at=started_at,
        )
        return episode, briefing

    def _register(self, variant: Variant, episode: _Watched, briefing: Briefing) -> OpenedEpisode:
        episode_id, watched = secrets.token_urlsafe(18), episode.watched
        self._open[episode_id] = episode
        return OpenedEpisode(variant, episode_id, episode.owner_token, watched.mcp_url, watched.token, briefing)

    async def reward(self, episode_id: str, token: str, ended: EndedEpisode) -> Reward:
        """Grade an ended episode. Each episode gets a reward only once.

        Args:
            episode_id: Id of the episode.
            token: Its owner token.
            ended: The trainer's statement of how the episode ended.

        Raises:
            RefusedRequest: The id is unknown, the token does not match, the episode is still running, or the reward
                was given already.
            InfrastructureError: The server failed, so the episode has no reward.
            StoreError: The record could not be written; the request may be repeated.
        """
        episode = self._owned(episode_id, token)
        if self.rule.per_iteration and ended.iterations is None:
            raise RefusedRequest(400, 'iterations cost here, so say how many there were: {"iterations": 7}')
        if episode.asked:
            raise RefusedRequest(409, "this episode is being graded now, for another request; a reward is given once")
        episode.asked = True
        try:
            found = await self._grade(episode, ended)
        finally:
            episode.asked = False
        self._graded[episode_id] = episode.owner_token
        while len(self._graded) > _REMEMBERED:
            self._graded.popitem(last=False)
        await self._close(episode_id)
        self.metrics.rewards[found.outcome] += 1
        self.metrics.reward_sum += found.reward
        self.variants.curricula.add(episode.variant, right=found.grade.strict is Verdict.CORRECT)
        return found

    async def _grade(self, episode: _Watched, ended: EndedEpisode) -> Reward:
        turns = await episode.watched.turns()
        outcome, answer = outcome_of(turns, episode.max_calls)
        if outcome is None:
            if ended.end is None:
                raise RefusedRequest(
                    409,
                    "the episode is still running: ask after its answer, or end it without one by sending"
                    ' {"end": "budget_exhausted"}',
                )
            outcome = Outcome(ended.end)
        played = Episode(
            key=self.recording.numbered(episode.key) if self.folder else episode.key,
            outcome=outcome,
            answer=answer,
            prompt=episode.prompt,
            turns=turns,
            error="the trainer ended it" if outcome is Outcome.AGENT_ERROR else None,
            max_calls=episode.max_calls,
            started_at=episode.started_at,
            duration_s=time.monotonic() - episode.opened_at,
            versions=self.record.versions_of(episode.key.scene),
        )
        iterations = len(turns) if ended.iterations is None else ended.iterations
        found = await self._reward(played, iterations, len(turns))
        if self.folder is not None:
            # Record the episode before its reward is sent, so that no run loses a finished episode.
            await self._in_thread(functools.partial(self.folder.append_episode, played))
            self.recording.splits.add(episode.variant.split)
        return found

    async def _reward(self, played: Episode, iterations: int, calls: int) -> Reward:
        """Compute the reward of an episode; raises `InfrastructureError` if the server failed."""
        if played.outcome is Outcome.INFRASTRUCTURE_ERROR:
            raise InfrastructureError(played.error or "the host failed during the episode")
        grade, answer, shaping = await self._in_thread(functools.partial(self._compared, played))
        cost = self.rule.cost(iterations, calls)
        return Reward(self.rule.reward(answer, iterations, calls), answer, cost, grade, played.outcome, calls, shaping)

    def _compared(self, played: Episode) -> tuple[Grade, AnswerReward, list[float] | None]:
        """Return the grade of an episode, the reward of its answer, and the shaping rewards of its calls."""
        answer = played.answer if played.outcome is Outcome.ANSWERED else None
        key = self.keys.key(played.key.scene, played.key.seed)
        shaping = shaping_of(played, self.host.seed_of, self.keys.folder) if self.shapes else None
        return grade_record(played, self.keys).grade, answer_reward(answer, key), shaping

    async def close(self, episode_id: str, token: str) -> None:
        """Close an episode without a reward.

        Raises:
            RefusedRequest: The id is unknown, or the token does not match.
        """
        self._owned(episode_id, token)
        self.metrics.closed += 1
        await self._close(episode_id)

    def _owned(self, episode_id: str, token: str) -> _Watched:
        episode = self._open.get(episode_id)
        owner_token = self._graded.get(episode_id) if episode is None else episode.owner_token
        if owner_token is None:
            raise RefusedRequest(404, _GONE)
        if not secrets.compare_digest(token.encode(), owner_token.encode()):
            raise RefusedRequest(401, "only who opened this episode may ask: send its owner_token as a bearer token")
        if episode is None:
            raise RefusedRequest(409, "the reward of this episode was given already; it is given once")
        return episode

    async def _close(self, episode_id: str) -> None:
        episode = self._open.pop(episode_id, None)
        if episode is not None:
            await episode.closing.aclose()

    async def sweep(self) -> None:
        """Close the episodes that are older than `max_wall_s`, except those that are being graded."""
        oldest = time.monotonic() - self.max_wall_s
        for episode_id, episode in list(self._open.items()):
            if episode.opened_at < oldest and not episode.asked:
                self.metrics.expired += 1
                await self._close(episode_id)

    async def close_all(self) -> None:
        """Close all open episodes, at the end of the process."""
        for episode_id in list(self._open):
            await self._close(episode_id)

    def played_record(self) -> RunRecord:
        """Return the run record with a plan that contains the recorded episodes only."""
        return self.recording.run_record(self.record, self.prover)

    async def _in_thread(self, work: functools.partial[T]) -> T:
        return await anyio.to_thread.run_sync(work, limiter=self._grading)
