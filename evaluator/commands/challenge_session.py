"""A running challenge: each participant plays at their own pace, on one shared episode server, into one run folder."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

import anyio.to_thread
from rich.console import Console

from evaluator.agents.browser.player import Ending, PageState, Visitor
from evaluator.answers.keys import KeyRing
from evaluator.calibration.adaptive import AdaptiveTest, DifficultyTable
from evaluator.commands.challenge_people import Challenge, Person, agreed, write_challenge
from evaluator.commands.human_episode import play_on_page
from evaluator.episode.connect import EpisodeConnector
from evaluator.errors import InfrastructureError, StoreError
from evaluator.records.episode import Choice, Episode, EpisodeKey, Verdict
from evaluator.records.run import RunRecord
from evaluator.scores.scoring import strict_verdict
from evaluator.store.run_folder import RunFolder
from scenes import PackFiles, reference_of

AGENT = "human"
"""Name of the agent in the records; the same for every person."""
TIME_OVER, ENDED = "the time was over", "the challenge was ended"
"""Reasons, besides the person's own decision, why an episode ended without an answer."""

_RETRY_S = 2.0
"""Time between two attempts to write to a run folder that cannot be written [s]."""

Next = tuple[EpisodeKey, Choice | None]


@dataclass(slots=True)
class RemainingEpisodes:
    """The episodes that a person has not played yet: a fixed list, or the pool of an adaptive test."""

    waiting: list[EpisodeKey]
    test: AdaptiveTest | None = None
    """Adaptive test that chooses from `waiting`, which it shares; None to play the episodes in order."""

    def following(self) -> Next | None:
        """Remove and return the next episode; None if there is none."""
        if self.test is not None:
            return next(iter(self.test.choose(1)), None)
        return (self.waiting.pop(0), None) if self.waiting else None

    def add(self, key: EpisodeKey, verdict: Verdict) -> None:
        """Pass the verdict on a played episode to the adaptive test, if there is one."""
        if self.test is not None and verdict is not Verdict.UNSCORED:
            self.test.add(key, is_right=verdict is Verdict.CORRECT)


def remaining_of(
    keys: Sequence[EpisodeKey], done: Mapping[EpisodeKey, Verdict], table: DifficultyTable | None, se: float | None
) -> RemainingEpisodes:
    """Return the episodes that a person has not played yet.

    Args:
        keys: All episodes that the person may play.
        done: Verdicts on the episodes that have been played.
        table: Difficulties for an adaptive test; None for a fixed list of episodes.
        se: Standard error at which the test ends [logits].
    """
    waiting = [key for key in keys if key not in done]
    if table is None or se is None:
        return RemainingEpisodes(waiting)
    left = RemainingEpisodes(waiting, AdaptiveTest(f"{AGENT} {keys[0].epoch}", table.difficulties, se, waiting))
    for key, verdict in done.items():
        left.add(key, verdict)
    return left


@dataclass(slots=True)
class RunningChallenge:
    """State of a running challenge."""

    folder: RunFolder
    challenge: Challenge
    record: RunRecord
    packs: Mapping[int, PackFiles]
    keys: KeyRing
    console: Console
    pages: dict[int, PageState] = field(default_factory=dict[int, PageState])
    """Number of a person → state of their page."""
    _writing: anyio.Lock = field(default_factory=anyio.Lock)
    _ended: anyio.Event = field(default_factory=anyio.Event)

    def page_of(self, person: Person) -> PageState:
        """Create the page of a person."""
        code = self.challenge.code(person.number)
        consent, has_agreed = self.challenge.consent(person.number), person.agreed_at is not None
        visitor = Visitor(code, consent, agreed=has_agreed, minutes=self.challenge.minutes)
        page = self.pages[person.number] = PageState(visitor=visitor)
        return page

    def end(self) -> None:
        """End all running episodes, and start no further one."""
        self._ended.set()
        for page in self.pages.values():
            page.close(ENDED)

    async def attend(self, person: Person, left: RemainingEpisodes, laboratory: EpisodeConnector) -> None:
        """Let a person consent and play, until all their episodes are played or their time is over."""
        page = self.pages[person.number]
        assert page.visitor is not None
        await page.agreement()
        if page.visitor.agreed:
            await self._start_clock(person, page.visitor)
            async with anyio.create_task_group() as tasks:
                tasks.start_soon(_end_in_time, page, page.visitor.ends_at)
                await self._play_all(page, left, laboratory)
                tasks.cancel_scope.cancel()
        page.end(Ending(self._farewell(page, page.visitor)))
        self.console.print(f"{page.visitor.code}: has finished", highlight=False)

    async def _write(self, write: Callable[[], object]) -> None:
        """Write to the run folder. While that fails, for example on a full disk, retry until the challenge is ended.

        Raises:
            StoreError: The folder could still not be written when the challenge ended.
        """
        is_reported = False
        while True:
            try:
                async with self._writing:
                    await anyio.to_thread.run_sync(write, abandon_on_cancel=False)
            except StoreError as error:
                if self._ended.is_set():
                    raise
                if not is_reported:
                    said = f"{error}; retrying until Ctrl-C, and no answer is lost before"
                    self.console.print(said, highlight=False, markup=False, soft_wrap=True)
                is_reported = True
            else:
                return
            with anyio.move_on_after(_RETRY_S):
                await self._ended.wait()

    async def _start_clock(self, person: Person, visitor: Visitor) -> None:
        """Record the consent, and set the end of the person's time. Restarting the command does not extend the time."""
        spent_s = 0.0
        if person.agreed_at is None:
            self.challenge = self.challenge.changed(agreed(person))
            await self._write(lambda: write_challenge(self.folder, self.challenge))
        else:
            spent_s = (datetime.now(UTC) - datetime.fromisoformat(person.agreed_at)).total_seconds()
        if self.challenge.minutes is not None:
            visitor.ends_at = time.monotonic() + 60 * self.challenge.minutes - spent_s

    async def _play_all(self, page: PageState, left: RemainingEpisodes, laboratory: EpisodeConnector) -> None:
        upcoming = left.following()
        while upcoming is not None and not page.is_closed:
            key, choice = upcoming
            try:
                ending = await self._played(page, key, choice, left, laboratory)
                upcoming = left.following()
                choices = {} if upcoming is None else {"next": "the next scene"}
            except InfrastructureError as error:
                self.console.print(f"scene {reference_of(key.scene)}: {error}", highlight=False, markup=False)
                ending = Ending("The laboratory failed, and this scene is not recorded.")
                choices = {"next": "this scene again"}
            if page.is_closed or not choices:
                return
            page.end(Ending(ending.sentence, ending.correct, choices=choices))
            await page.choice(math.inf)
            if not page.is_closed:
                page.begin()

    async def _played(
        self,
        page: PageState,
        key: EpisodeKey,
        choice: Choice | None,
        left: RemainingEpisodes,
        laboratory: EpisodeConnector,
    ) -> Ending:
        """Play and record an episode.

        An episode that the organiser or the time limit ended before its first turn is not recorded.

        Raises:
            InfrastructureError: The laboratory failed.
        """
        async with laboratory.open(key.scene, key.seed) as client:
            versions = self.record.versions_of(key.scene)
            episode = await play_on_page(page, client, key, self.packs[key.scene], versions)
        if page.is_closed and not episode.turns:
            return Ending(ENDED)
        await self._write(lambda: self.folder.append_episode(episode.model_copy(update={"chosen": choice})))
        verdict = strict_verdict(episode, self.keys)
        left.add(key, verdict)
        assert page.visitor is not None
        said = f"{page.visitor.code}: scene {reference_of(key.scene)}, {episode.outcome.replace('_', ' ')}"
        self.console.print(said, highlight=False, markup=False)
        return self._ending(episode, verdict)

    def _ending(self, episode: Episode, verdict: Verdict) -> Ending:
        if not self.challenge.feedback or verdict is Verdict.UNSCORED:
            answered = episode.answer is not None
            return Ending("Your answer is recorded." if answered else "This scene is over without an answer.")
        spent = f"{len(episode.turns)} of {episode.key.budget} iteration{'s' * (episode.key.budget != 1)}"
        is_right = verdict is Verdict.CORRECT
        return Ending(f"{'Correct' if is_right else 'Not correct'}, in {spent}.", is_right)

    def _farewell(self, page: PageState, visitor: Visitor) -> str:
        is_late = visitor.ends_at is not None and time.monotonic() >= visitor.ends_at
        said = "The time is over." if is_late else "The challenge has ended." if page.is_closed else "That was all."
        if not visitor.agreed:
            return said
        asks = f"To have your data deleted, give your code, {visitor.code}, to {self.challenge.organiser}."
        return f"{said} Thank you. {asks}"


async def _end_in_time(page: PageState, ends_at: float | None) -> None:
    """End the person's episode when their time is over, and start no further one."""
    await anyio.sleep(math.inf if ends_at is None else max(0.0, ends_at - time.monotonic()))
    page.close(TIME_OVER)
