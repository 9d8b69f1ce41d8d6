"""Tests of curricula: the window follows a simulated learner's success rate, and a referee takes variants from it."""

import math
import random
import threading
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from evaluator.answers.keys import KeyRing
from evaluator.errors import RefusedRequest
from evaluator.referee import curriculum
from evaluator.referee.contract import Variant, WantedEpisode, WantedWorld
from evaluator.referee.curriculum import ENOUGH, WIDTH, Curricula, Window, steps_of
from evaluator.referee.variants import Variants
from scenes import default_folder, place_of
from scenes.splits import splits
from scenes.worlds.folders import levels_of, worlds_of
from tests.builders.referee_client import referee_client
from tests.evaluator.referee.test_referee import GIVE_UP, RECORD, played_by_reference, refereeing, sentence

TRAIN = splits()["train"]
DIFFICULTIES = {scene: (place / 5 - 5.0, 0.1) for place, scene in enumerate(TRAIN.scenes)}


class Learner:
    """A simulated learner: it succeeds with the probability of the Rasch model, and learns from the variance of its
    rewards.

    A group of equal rewards has no gradient, so a step with success probability p teaches in proportion to p (1 - p).
    """

    def __init__(self, seed: int) -> None:
        self.ability, self._random = -4.0, random.Random(seed)

    def attempt(self, difficulty: float) -> bool:
        p = 1 / (1 + math.exp(difficulty - self.ability))
        self.ability += 0.02 * p * (1 - p)
        return self._random.random() < p


def taught(window: Window, learner: Learner, episodes: int) -> list[bool]:
    """Let a learner play episodes of random steps of a window; step n has a difficulty of n - 4."""
    drawn, results = random.Random(1), list[bool]()
    for _ in range(episodes):
        step = drawn.randint(window.low, window.high)
        results.append(learner.attempt(step - 4.0))
        window.add(step, right=results[-1])
        assert 0 <= window.low <= window.high < window.steps
        assert window.high - window.low < WIDTH
    return results


@pytest.mark.parametrize("seed", range(5))
def test_a_window_follows_a_learner_that_gets_better_and_one_that_forgets(seed: int) -> None:
    window, learner = Window(steps=10), Learner(seed)
    taught(window, learner, 1000)
    results = taught(window, learner, 1000)
    assert 0.4 < sum(results) / len(results) < 0.9
    assert abs(window.high - 4.0 - learner.ability) < 2.5
    reached = window.high
    assert reached >= 4
    learner.ability = -4.0
    taught(window, learner, 400)
    assert window.high < reached - 2


@pytest.mark.parametrize("seed", range(5))
def test_a_learner_gets_further_with_a_window_than_with_all_steps(seed: int) -> None:
    window, with_window, without = Window(steps=20), Learner(seed), Learner(seed)
    taught(window, with_window, 4000)
    drawn = random.Random(1)
    for _ in range(4000):
        without.attempt(drawn.randrange(20) - 4.0)
    assert with_window.ability > without.ability + 1


def test_rewards_of_other_steps_and_of_before_a_move_count_for_nothing() -> None:
    window = Window(steps=3)
    for _ in range(ENOUGH):
        window.add(0, right=True)
    assert (window.low, window.high, window.tried) == (0, 1, 0)
    for _ in range(2 * ENOUGH):
        window.add(0, right=True)
    assert (window.high, window.tried) == (1, 0)
    for right in [True, False] * ENOUGH:
        window.add(1, right=right)
    assert window.high == 1
    for step, right, reached in ((1, True, 2), (2, True, 2), (2, False, 1), (1, False, 0), (0, False, 0)):
        for _ in range(ENOUGH):
            window.add(step, right=right)
        assert window.high == reached


def test_scenes_are_divided_by_difficulty_and_worlds_by_level() -> None:
    known = {scene: value for scene, value in DIFFICULTIES.items() if scene != TRAIN.scenes[0]}
    steps = steps_of(TRAIN, known)
    assert len(steps) <= curriculum.STEPS
    assert [scene for step in steps for scene in step] == list(TRAIN.scenes[1:])
    with pytest.raises(RefusedRequest, match="no scene of train@1 has a known difficulty"):
        steps_of(TRAIN, {})
    offered = Variants(KeyRing(), RECORD)
    levels = set[int]()
    for seed in range(20):
        variant = offered.select(WantedEpisode(world=WantedWorld(), random_seed=seed), "mine")
        assert (variant.step, variant.split) == (("mine", 0, 0), "")
        levels.add(place_of(variant.scene)[0])
    assert levels == {1}
    folder = default_folder()
    published = [len(worlds_of(folder, level)) for level in levels_of(folder)]
    assert [len(step) for step in offered.curricula.state("mine")["steps"]] == published


def drawing() -> Callable[..., Variant]:
    offered = Variants(KeyRing(), RECORD, DIFFICULTIES)

    def draw(name: str, number: int, **wanted: Any) -> Variant:
        variant = offered.select(WantedEpisode(split="train", random_seed=number, **wanted), name)
        assert variant.index is not None
        assert TRAIN.scenes[variant.index % len(TRAIN.scenes)] == variant.scene
        assert TRAIN.seeds[variant.index // len(TRAIN.scenes)] == variant.seed
        return variant

    return draw


def test_a_draw_repeats_itself_and_covers_the_window() -> None:
    draw = drawing()
    first = [draw("mine", seed) for seed in range(100)]
    assert first == [replace(draw("other", seed), step=("mine", 0, 0)) for seed in range(100)]
    assert {variant.scene for variant in first} == set(steps_of(TRAIN, DIFFICULTIES)[0])
    for wanted in ({"scene": 7}, {"seed": 3}, {"index": 3}):
        with pytest.raises(RefusedRequest, match="a curriculum draws the variant"):
            draw("mine", 1, **wanted)


def test_curricula_are_apart_bounded_and_keep_to_their_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(curriculum, "MOST", 2)
    curricula, steps = Curricula(), ((7,), (9,))
    drawn, _ = [curricula.draw(name, TRAIN, steps, 1) for name in ("a", "b")]
    for _ in range(ENOUGH):
        curricula.add(drawn, right=True)
        curricula.add(replace(drawn, step=("unknown", 0, 0)), right=True)
        curricula.add(replace(drawn, step=None), right=True)
    assert (curricula.state("a")["high"], curricula.state("b")["high"]) == (1, 0)
    with pytest.raises(RefusedRequest, match="has other scenes, of train@1"):
        curricula.draw("a", TRAIN, ((7, 9),), 1)
    curricula.draw("c", TRAIN, steps, 1)
    with pytest.raises(RefusedRequest, match="no such curriculum"):
        curricula.state("b")
    assert curricula.state("a")["high"] == 1


def test_rewards_of_before_a_move_or_a_reset_count_for_nothing() -> None:
    curricula, steps = Curricula(), ((7,), (9,))
    first = curricula.draw("a", TRAIN, steps, 1)
    for _ in range(ENOUGH):
        curricula.add(first, right=True)
    harder = next(one for n in range(99) if (one := curricula.draw("a", TRAIN, steps, n)).scene == 9)
    for _ in range(ENOUGH):
        curricula.add(harder, right=False)
    curricula.add(first, right=True)
    assert (curricula.state("a")["high"], curricula.state("a")["tried"]) == (0, 0)
    again = curricula.draw("a", TRAIN, steps, 1)
    curricula.reset("a")
    curricula.draw("a", TRAIN, steps, 1)
    curricula.add(again, right=True)
    assert curricula.state("a")["tried"] == 0


def test_a_curriculum_that_is_reset_during_a_draw_is_deleted_after_it() -> None:
    curricula, steps = Curricula(), ((7,), (9,))
    curricula.draw("a", TRAIN, steps, 1)
    resets = list[threading.Thread]()

    class Interrupted(OrderedDict[str, Any]):
        """Starts a reset in another thread just before `draw` marks its curriculum as used."""

        def move_to_end(self, key: str, last: bool = True) -> None:
            resets.append(threading.Thread(target=curricula.reset, args=("a",)))
            resets[0].start()
            resets[0].join(0.2)  # ends before 0.2 s if nothing blocks the reset
            super().move_to_end(key, last)

    curricula._named = Interrupted(curricula._named)  # pyright: ignore[reportPrivateUsage] - no other way to interleave
    assert curricula.draw("a", TRAIN, steps, 1).scene == 7
    resets[0].join()
    with pytest.raises(RefusedRequest, match="no such curriculum"):
        curricula.state("a")


def test_curricula_with_equal_steps_share_them() -> None:
    curricula = Curricula()
    for name in ("a", "b"):
        curricula.draw(name, TRAIN, tuple((scene,) for scene in TRAIN.scenes), 1)
    assert curricula.state("a")["steps"] is curricula.state("b")["steps"]


async def test_a_referee_moves_the_window_by_its_rewards_and_resets_it(
    host_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(curriculum, "ENOUGH", 2)
    difficulties = {7: (-2.0, 0.1), 23: (1.0, 0.1)}
    async with refereeing(host_url, difficulties=difficulties) as trainer:
        asked = {"curriculum": "run-1", "split": "train", "random_seed": 4, "count": 3}
        group = (await trainer.http.post("/episodes", json=asked)).json()
        assert group["scene"] == 7
        seed = TRAIN.seeds[group["index"] // len(TRAIN.scenes)]
        for one in group["episodes"][:2]:
            await played_by_reference(one | {"budget": 20}, 7, seed)
            assert (await trainer.reward(one)).json()["reward"] == 1.0
        assert (await trainer.reward(group["episodes"][2], GIVE_UP)).json()["reward"] == 0.0
        state = (await trainer.http.get("/curricula/run-1")).json()
        assert state == {"pool": "train@1", "steps": [[7], [23]], "low": 0, "high": 1, "tried": 0, "right": 0}
        scenes = {
            (await trainer.http.post("/episodes", json=asked | {"random_seed": seed})).json()["scene"]
            for seed in range(4)
        }
        assert scenes == {7, 23}
        assert (await trainer.http.delete("/curricula/run-1")).status_code == 204
        gone = await trainer.http.get("/curricula/run-1")
        assert (gone.status_code, "no such curriculum" in sentence(gone)) == (404, True)
        for body in ({"curriculum": "a/b", "split": "train"}, {"curriculum": "mine"}, asked | {"scene": 7}):
            assert (await trainer.http.post("/episodes", json=body)).status_code == 400


async def test_only_the_holder_of_the_token_reads_and_resets_curricula(host_url: str) -> None:
    async with refereeing(host_url, token="secret") as trainer:
        for ask in (trainer.http.get, trainer.http.delete):
            assert (await ask("/curricula/mine")).status_code == 401


def test_the_shared_client_reads_and_resets_curricula(web_server: Any) -> None:
    with web_server(200, b'{"low": 0}') as url:
        assert referee_client().Referee(url).curriculum("mine") == {"low": 0}
        referee_client().Referee(url).reset_curriculum("mine")
