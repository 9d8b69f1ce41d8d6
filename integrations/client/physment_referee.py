"""A client of `physment-eval referee`, which opens episodes and requests their rewards. Standard library only.

The integrations share it, because they may not import the laboratory or the evaluator.
"""

import json
import os
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

URL = "http://127.0.0.1:8900"
"""Default address of a referee."""
URL_VARIABLE = "PHYSMENT_REFEREE_URL"
TOKEN_VARIABLE = "PHYSMENT_REFEREE_TOKEN"  # noqa: S105 - a name, not a token
"""Environment variable with the token that a referee requires for opening episodes."""
ANSWER = "answer"
"""Name of the tool that ends an episode."""
_MOST = 1_000_000
"""Longest range of numbers that is accepted; a longer one is assumed to be a typing error."""

_NUMBERS = ("scene", "seed", "index", "random_seed")
"""Numeric fields that select a variant."""
_FIELDS = frozenset({*_NUMBERS, "split", "world", "curriculum"})
"""All fields that select a variant."""

Variant = dict[str, Any]
"""The selection of a variant in a request: some of `scene`, `seed`, `world`, `split`, `index`, `random_seed` and
`curriculum`."""
End = Literal["budget_exhausted", "agent_error"]
"""Why an episode ends without an answer."""


class RefereeError(Exception):
    """The referee refused the request or cannot be reached; the message is one sentence."""

    retry_after_s: float | None = None
    """Set if the referee is at its limit of open episodes: wall time after which to retry [s]."""


@dataclass(frozen=True, slots=True)
class OpenedEpisode:
    """An opened episode: its addresses, tokens and prompt."""

    episode_id: str
    owner_token: str = field(repr=False)
    """Token for requesting the reward. The agent must not receive it."""
    mcp_url: str
    """Address for the agent's calls."""
    player_token: str = field(repr=False)
    """The bearer token of these calls."""
    prompt: str
    tools: tuple[dict[str, Any], ...] = field(repr=False)
    """Descriptions of the tools, each with `name`, `description` and `input_schema`."""
    budget: int
    """Number of iterations that the prompt states."""
    scene: int
    world: str | None = None
    """Reference of a world, such as `world:5:17`."""
    split: str | None = None
    """Name and version of the split that the variant was taken from, such as `train@1`."""
    index: int | None = None
    """Index of the variant in the split; a later request with this index gets the same variant."""


@dataclass(frozen=True, slots=True)
class Reward:
    """The reward of an episode, with its verdicts."""

    reward: float
    strict: str
    """`correct` or `incorrect`."""
    graded: float
    """Share of the parts of the answer that are right."""
    normalised: str
    outcome: str
    calls: int
    parts: tuple[bool, ...] = ()
    """For each part of the answer, whether it is right."""
    chance: float = 0.0
    """Probability that a blind guess is right."""
    cost: float = 0.0
    """Deduction for iterations and calls."""
    shaping: tuple[float, ...] | None = None
    """How much each call lowered the error bound of the answer; None without `referee --shaping`. Not for the agent."""


@dataclass(frozen=True, slots=True)
class Referee:
    """Client of the referee at one address."""

    url: str = URL
    token: str | None = field(default=None, repr=False)
    """Bearer token for opening episodes; None if any program on the referee's machine may open them."""
    timeout_s: float = 120.0

    @classmethod
    def from_environment(cls) -> "Referee":
        """Return a client of the referee that `PHYSMENT_REFEREE_URL` and `PHYSMENT_REFEREE_TOKEN` name."""
        return cls(os.environ.get(URL_VARIABLE) or URL, os.environ.get(TOKEN_VARIABLE) or None)

    def open(self, scene: int | None = None, seed: int | None = None, **options: Any) -> OpenedEpisode:
        """Open an episode.

        Args:
            scene: Id of the scene.
            seed: Variant of the scene; 0 if neither a seed nor a split is named.
            options: `split` with `index` or `random_seed` instead of a seed; `world` instead of a scene, such as
                `{"level": 5}`; `curriculum` (a name) with a split or a world, so that the referee draws the variant
                from the window of this curriculum; `budget`, `max_calls` and `prompting`, if other than the referee's
                defaults. None stands for the default.

        Raises:
            RefereeError: The referee refused, or cannot be reached.
        """
        (opened,) = self.open_group(1, scene, seed, **options)
        return opened

    def open_when_free(self, patience_s: float, **wanted: Any) -> OpenedEpisode:
        """Open an episode; while the referee is at its limit of open episodes, wait and retry.

        Args:
            patience_s: Longest time to wait [s].
            wanted: As for `open`.

        Raises:
            RefereeError: The referee refused, cannot be reached, or stayed at its limit.
        """
        until = time.monotonic() + patience_s
        while True:
            try:
                return self.open(**wanted)
            except RefereeError as error:
                if error.retry_after_s is None or time.monotonic() + error.retry_after_s > until:
                    raise
                time.sleep(error.retry_after_s)

    def open_group(
        self, count: int, scene: int | None = None, seed: int | None = None, **options: Any
    ) -> tuple[OpenedEpisode, ...]:
        """Open several episodes of one variant, such as the rollouts of one prompt. All are opened, or none.

        Args:
            count: Number of episodes, at most 64.
            scene: As for `open`.
            seed: As for `open`.
            options: As for `open`.

        Raises:
            RefereeError: As for `open`.
        """
        found = self._ask("POST", "/episodes", _given(scene=scene, seed=seed, count=count, **options), self.token)
        shared = found | {"tools": tuple(found["tools"])}
        return tuple(OpenedEpisode(**shared | one) for one in shared.pop("episodes"))

    def variants(self, **query: Any) -> dict[str, Any]:
        """Return properties of the scenes of a split, or of worlds: rung, chance, reference, difficulty.

        Args:
            query: `split`, such as `train`; for worlds, `level` and the other fields of `world`; `offset` and `limit`.

        Raises:
            RefereeError: The referee refused, or cannot be reached.
        """
        return self._ask("GET", f"/variants?{urllib.parse.urlencode(_given(**query))}", None, self.token)

    def curriculum(self, name: str) -> dict[str, Any]:
        """Return the window of a curriculum (its `low` and `high` step) and the scenes of all `steps`, easiest first.

        Raises:
            RefereeError: No episode was drawn from the curriculum yet, or the referee refused or cannot be reached.
        """
        return self._ask("GET", f"/curricula/{name}", None, self.token)

    def reset_curriculum(self, name: str) -> None:
        """Reset a curriculum to its easiest step.

        Raises:
            RefereeError: The referee refused, or cannot be reached.
        """
        self._ask("DELETE", f"/curricula/{name}", None, self.token)

    def reward(self, episode_id: str, owner_token: str, *, iterations: int, end: End | None = None) -> Reward:
        """Request the reward of an episode. The referee gives it once.

        Args:
            episode_id: The episode.
            owner_token: Its owner token.
            iterations: Number of replies of the agent.
            end: Ends an episode without an answer, with this outcome; an answered episode keeps its answer.

        Raises:
            RefereeError: The referee refused, or cannot be reached.
        """
        body = {"iterations": iterations} | ({"end": end} if end else {})
        return _reward(self._ask("POST", f"/episodes/{episode_id}/reward", body, owner_token))

    def close(self, episode_id: str, owner_token: str) -> None:
        """Close an episode without a reward.

        Raises:
            RefereeError: The referee refused, or cannot be reached.
        """
        self._ask("DELETE", f"/episodes/{episode_id}", None, owner_token)

    def check(self, scene: int | None = None, seed: int | None = None, **options: Any) -> Reward:
        """Let the referee's host play the reference protocol of a scene; returns the reward.

        Args:
            scene: As for `open`.
            seed: As for `open`.
            options: As for `open`.

        Raises:
            RefereeError: The referee refused, or cannot be reached.
        """
        return _reward(self._ask("POST", "/checks", _given(scene=scene, seed=seed, **options), self.token))

    def _ask(self, method: str, path: str, body: Any, token: str | None) -> dict[str, Any]:
        if not self.url.startswith(("http://", "https://")):
            raise RefereeError(f"{self.url!r} is not the URL of a referee, such as {URL}")
        headers = {"Content-Type": "application/json"} | ({"Authorization": f"Bearer {token}"} if token else {})
        content = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.url.rstrip("/") + path, content, headers, method=method)  # noqa: S310 - checked above
        try:
            with urllib.request.urlopen(request, timeout=self.timeout_s) as reply:  # noqa: S310 - as above
                return json.loads(reply.read() or b"{}")
        except urllib.error.HTTPError as error:
            refusal = RefereeError(_sentence(error))
            delay = error.headers.get("Retry-After", "")
            refusal.retry_after_s = float(delay) if error.code == 429 and delay.isdecimal() else None
            raise refusal from error
        except (OSError, ValueError) as error:
            raise RefereeError(
                f"the referee {self.url} cannot be reached ({error}): start `physment-eval referee`, and put its"
                f" address into {URL_VARIABLE}"
            ) from error


def _sentence(error: urllib.error.HTTPError) -> str:
    try:
        return f"the referee refused: {json.loads(error.read())['error']}"
    except (ValueError, LookupError, TypeError):
        return f"this is no PhysMent referee: it answered {error.code}"


def _reward(found: dict[str, Any]) -> Reward:
    return Reward(**{name: tuple(value) if isinstance(value, list) else value for name, value in found.items()})


def _given(**values: Any) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def read_variants(
    scenes: str = "",
    seeds: str = "",
    file: Path | None = None,
    *,
    split: str = "",
    levels: str = "",
    indices: str = "",
    random_seeds: str = "",
    curriculum: str = "",
) -> Iterator[Variant]:
    """Return variants to request from a referee, each as the arguments of `Referee.open`.

    Args:
        scenes: Ids and ranges such as `7,21-30`.
        seeds: Seeds and ranges (by default 1); all scenes are listed with the first seed before the second.
        file: A file with a line of JSON for each variant, such as `{"scene": 7, "seed": 3}`; other arguments are then
            ignored.
        split: Name of a split; its variants are selected by `indices` or `random_seeds`, or by scenes and seeds.
        levels: Levels of generated worlds, such as `1-3`, instead of scenes; with a split, only its worlds.
        indices: Indices in the split or among the worlds of each level, such as `0-99`.
        random_seeds: Each selects one such index at random; with `scenes`, one index for each scene.
        curriculum: Name of a curriculum on the split or on the worlds of one level or of all (`levels` empty). For each
            of the `random_seeds`, the referee chooses a variant from the present window of the curriculum.

    Raises:
        ValueError: An argument or a line is malformed; the message is one sentence.
    """
    if file is not None:
        yield from _in_file(file)
        return
    chosen: list[Variant] = [{"scene": scene} for scene in _numbers(scenes, "scenes")] if scenes else []
    named: Variant = {"split": split} if split else {}
    if curriculum:
        if not random_seeds or scenes or seeds or indices or len(worlds := _worlds(levels)) > 1:
            raise ValueError(
                'a curriculum draws from a split or from worlds of a level: curriculum "a", split "train", random_seeds'
                ' "1-100"'
            )
        pool = {**named, **(worlds[0] if worlds else {} if split else {"world": {}}), "curriculum": curriculum}
        parts = [{**pool, "random_seed": number} for number in _numbers(random_seeds, "random_seed")]
    elif indices or random_seeds:
        if not (split or levels) or (indices and (random_seeds or scenes)) or seeds or (levels and scenes):
            raise ValueError('name a split with indices, or with random_seeds: split "train", indices "0-99"')
        name, text = ("index", indices) if indices else ("random_seed", random_seeds)
        pools = chosen or _worlds(levels) or [{}]
        parts = [{**named, **pool, name: number} for number in _numbers(text, name) for pool in pools]
    elif chosen and not levels and (seeds or not split):
        parts = [{**named, **scene, "seed": seed} for seed in _numbers(seeds or "1", "seeds") for scene in chosen]
    else:
        raise ValueError(
            'name scenes, such as "7,21-30", a split or levels with indices, such as "0-99", or a file with a line for'
            " each"
        )
    yield from parts


def _worlds(levels: str) -> list[Variant]:
    return [{"world": {"level": level}} for level in _numbers(levels, "levels")] if levels else []


def _in_file(file: Path) -> Iterator[Variant]:
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {error.strerror}") from error
    for number, line in enumerate(lines, start=1):
        try:
            found = {name: value for name, value in json.loads(line).items() if name in _FIELDS}
        except (ValueError, AttributeError):
            found = {}
        numbers = {name: value for name, value in found.items() if name in _NUMBERS}
        named = {"scene", "seed"} <= numbers.keys() or (found.keys() & {"split", "world"} and numbers)
        if not named or not all(type(value) is int for value in numbers.values()):
            raise ValueError(
                f'{file}, line {number}: write {{"scene": 7, "seed": 3}} or {{"split": "train", "index": 0}},'
                f" not {line[:80]!r}"
            )
        yield found


def name_of(variant: Variant) -> str:
    """Return a short name of a requested variant, such as `scene7-seed3`, `train-index0` or `level5-index0`."""
    parts = [variant[name] for name in ("curriculum", "split") if name in variant]
    parts += [f"{name}{value}" for name, value in sorted(variant.get("world", {}).items())]
    return "-".join([*parts, *(f"{name}{variant[name]}" for name in _NUMBERS if name in variant)])


def _numbers(text: str, what: str) -> list[int]:
    found: list[int] = []
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        high = high if dash else low
        if not (low.isdecimal() and high.isdecimal() and 0 <= int(high) - int(low) < _MOST):
            raise ValueError(f"{what} {part.strip()!r}: write whole numbers and ranges such as 7,21-30")
        found += range(int(low), int(high) + 1)
    return list(dict.fromkeys(found))
