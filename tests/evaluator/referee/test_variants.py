"""Tests of how requests select variants, and of a referee that opens, records and grades held-back variants."""

import contextlib
import json
from collections import Counter
from collections.abc import AsyncGenerator
from pathlib import Path

import httpx
import httpx2
import pytest

from evaluator.agents.reference import ReferenceAgent
from evaluator.answers.keys import KeyRing
from evaluator.episode.hosts import HostConnector, mcp_client
from evaluator.episode.loop import play_episode
from evaluator.errors import RefusedRequest
from evaluator.records.run import Plan, RunRecord, SeedKey, SeedOf, ServerRecord, seed_as_recorded
from evaluator.referee.contract import Variant, WantedEpisode
from evaluator.referee.episodes import Referee
from evaluator.referee.requests import app
from evaluator.referee.selection import variant_of
from evaluator.scores.scoring import grade_run
from evaluator.store.run_folder import RunFolder
from scenes.splits import splits
from tests.builders.records import VERSIONS, episode_key

KEY = SeedKey(bytes(range(32)))
PLAN = Plan(scenes=(7,), agents=("trainer",))


def wanted(held_back: bool = False, **values: object) -> Variant:
    return variant_of(WantedEpisode.model_validate(values), held_back=held_back)


def test_without_a_split_a_variant_is_a_scene_and_a_seed() -> None:
    assert wanted(scene=7, seed=3) == Variant(7, 3)
    assert wanted(scene=7) == Variant(7, 0)
    assert wanted(held_back=True, scene=7, seed=3) == Variant(7, 3)


def test_the_places_of_a_split_are_its_scenes_at_the_first_seed_then_at_the_second() -> None:
    test = splits()["test"]
    places = [(found.scene, found.seed) for found in (wanted(split="test", index=index) for index in range(105 * 20))]
    assert places == [(scene, seed) for seed in test.seeds for scene in test.scenes]


@pytest.mark.parametrize("name", sorted(splits()))
def test_a_drawn_variant_is_in_the_split_and_is_named_by_its_place(name: str) -> None:
    split = splits()[name]
    for number in range(50):
        found = wanted(split=name, random_seed=number)
        assert found.scene in split.scenes
        assert found.seed in split.seeds
        assert found == wanted(split=split.label, index=found.index) == wanted(split=name, random_seed=number)
        assert found == wanted(split=name, scene=found.scene, seed=found.seed)


def test_draws_are_uniform_and_may_be_limited_to_a_scene() -> None:
    found = [wanted(split="validation", random_seed=number) for number in range(6400)]
    counts = Counter(one.scene for one in found)
    assert len(counts) == 64
    # Each scene is drawn 100 times on average, with a standard deviation of 10.
    assert min(counts.values()) > 55
    assert max(counts.values()) < 150
    assert {wanted(split="train", scene=7, random_seed=number).scene for number in range(20)} == {7}


def test_all_variants_of_a_referee_with_a_key_are_held_back() -> None:
    first = wanted(held_back=True, split="held-back", index=0)
    assert first == Variant(7, 0, "held-back@1", 0)
    assert wanted(held_back=True, split="held-back", index=105).seed == 1


@pytest.mark.parametrize(
    ("held_back", "values", "status", "says"),
    [
        (False, {}, 400, "names no variant"),
        (False, {"scene": 7, "index": 1}, 400, "places in a split, which is missing"),
        (False, {"random_seed": 1}, 400, "places in a split, which is missing"),
        (False, {"split": "train"}, 400, "name one of index, random_seed"),
        (False, {"split": "train", "index": 1, "random_seed": 1}, 400, "name one of index, random_seed"),
        (False, {"split": "train", "seed": 10_000}, 400, "name one of index, random_seed"),
        (False, {"split": "training", "index": 0}, 404, "there is no split 'training'; the splits are train, "),
        (False, {"split": "train@2", "index": 0}, 404, "there is no split 'train@2' here; this suite has train@1"),
        (False, {"split": "train", "index": 54 * 90_000}, 404, "train@1 has 4860000 variants"),
        (False, {"split": "train", "scene": 8, "random_seed": 0}, 404, "scene 8 is not in the split train@1"),
        (
            False,
            {"split": "train", "scene": 7, "seed": 3},
            404,
            "seed 3 is not in the split train@1; it has 10000-99999",
        ),
        (False, {"split": "train", "scene": 7, "index": 1}, 400, "variant 1 of train@1 is one of scene 9, not of 7"),
        (False, {"split": "held-back", "index": 0}, 404, "start the referee with --seed-key"),
        (True, {"split": "train", "index": 0}, 409, "all its variants are those of held-back"),
    ],
)
def test_what_names_no_variant_is_refused_in_one_sentence(
    held_back: bool, values: dict[str, object], status: int, says: str
) -> None:
    with pytest.raises(RefusedRequest, match=says.replace("(", r"\(")) as refused:
        wanted(held_back, **values)
    assert (refused.value.status, len(str(refused.value).splitlines())) == (status, 1)


@contextlib.asynccontextmanager
async def refereeing(
    host_url: str, folder: RunFolder, seed_of: SeedOf = seed_as_recorded, plan: Plan = PLAN
) -> AsyncGenerator[tuple[Referee, httpx.AsyncClient]]:
    record = RunRecord(
        created_at="2026-01-01T00:00:00+00:00",
        plan=plan,
        server=ServerRecord(option="host", protocol="x"),
        packs={"7": "p"},
        versions={"physment-mcp": "0"},
    )
    folder.create(resume=False)
    referee = Referee(HostConnector(host_url, seed_of=seed_of), KeyRing(seed_of=seed_of), record, folder=folder)
    served = app(referee)
    async with (
        served.router.lifespan_context(served),
        httpx.AsyncClient(transport=httpx.ASGITransport(served), base_url="http://127.0.0.1") as http,
    ):
        yield referee, http


async def solved(http: httpx.AsyncClient, request: dict[str, object]) -> tuple[dict[str, object], float]:
    """Let the reference protocol play a requested episode; returns the reply and the reward."""
    opened = (await http.post("/episodes", json=request)).json()
    headers = {"Authorization": f"Bearer {opened['player_token']}"}
    async with httpx2.AsyncClient(headers=headers) as http2, mcp_client(opened["mcp_url"], http2) as client:
        await play_episode(ReferenceAgent(), client, episode_key(7, agent="reference"), VERSIONS)
    owner = {"Authorization": f"Bearer {opened['owner_token']}"}
    reply = await http.post(f"/episodes/{opened['episode_id']}/reward", json={}, headers=owner)
    return opened, reply.json()["reward"]


async def test_a_run_on_one_split_is_recorded_as_such(host_url: str, tmp_path: Path) -> None:
    async with refereeing(host_url, RunFolder(tmp_path / "run")) as (referee, http):
        opened, reward = await solved(http, {"split": "train", "index": 54})
        assert reward == 1.0
        assert (opened["scene"], opened["split"], opened["index"]) == (7, "train@1", 54)
        assert (referee.played_record().plan.split, referee.played_record().plan.seeds) == ("train@1", (10_001,))
        await solved(http, {"scene": 7, "seed": 3})
        assert referee.played_record().plan.split == ""


async def test_a_held_back_variant_is_solved_and_recorded_without_its_seed(host_url: str, tmp_path: Path) -> None:
    folder, drawn = RunFolder(tmp_path / "run"), KEY.seed(7, 2)
    plan = Plan(scenes=(7,), agents=("trainer",), split="held-back", held_back=KEY.commitment)
    async with refereeing(host_url, folder, KEY.seed, plan) as (referee, http):
        opened, reward = await solved(http, {"split": "held-back", "index": 2 * 105})
        assert (reward, opened["index"]) == (1.0, 210)
        record = referee.played_record()
    assert (record.plan.seeds, record.plan.split) == ((2,), "held-back")
    told = json.dumps(opened) + folder.episodes_file.read_text(encoding="utf-8") + record.model_dump_json()
    assert str(drawn) not in told
    assert grade_run(folder, KeyRing(seed_of=KEY.seed)).summary.overall.n_correct == 1
    assert KeyRing().key(7, 2).value != KeyRing(seed_of=KEY.seed).key(7, 2).value
