"""Tests of a referee's groups of episodes of one variant, its lists of scenes with their properties, its counters."""

import json
import re
from pathlib import Path
from typing import Any

import httpx
import pytest

from evaluator.answers.keys import KeyRing
from evaluator.episode.hosts import HostConnector
from evaluator.errors import RefusedRequest
from evaluator.referee.contract import MOST_IN_GROUP, WantedVariants
from evaluator.referee.episodes import Referee
from evaluator.referee.requests import app
from evaluator.referee.variants import Variants
from scenes.splits import splits
from tests.builders.referee_client import referee_client
from tests.builders.worlds import write_worlds
from tests.evaluator.referee.test_referee import GIVE_UP, RECORD, played_by_reference, refereeing, sentence


async def test_a_group_is_of_one_variant_and_each_episode_has_its_own_reward(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        asked = {"scene": 23, "split": "train", "random_seed": 5, "count": 3}
        group = (await trainer.http.post("/episodes", json=asked)).json()
        again = (await trainer.http.post("/episodes", json=asked | {"count": 1})).json()
        assert (group["index"], group["prompt"], group["tools"]) == (again["index"], again["prompt"], again["tools"])
        first, second, third = group["episodes"]
        assert len({one[name] for one in group["episodes"] for name in ("episode_id", "owner_token", "mcp_url")}) == 9
        seed = splits()["train"].seeds[group["index"] // len(splits()["train"].scenes)]
        played = await played_by_reference(first | {"budget": 20}, 23, seed)
        assert played.prompt == group["prompt"]
        rewards = [(await trainer.reward(one, GIVE_UP)).json()["reward"] for one in (first, second)]
        assert rewards == [1.0, 0.0]
        assert (await trainer.reward(second, GIVE_UP, third["owner_token"])).status_code == 401
        assert trainer.referee.open_episodes == 2


async def test_a_group_that_has_no_place_opens_nothing(host_url: str) -> None:
    async with refereeing(host_url, max_episodes=3) as trainer:
        await trainer.open()
        full = await trainer.http.post("/episodes", json={"scene": 7, "count": 3})
        assert (full.status_code, full.headers["retry-after"]) == (429, "5")
        assert "1 episodes are open, and 3 is the limit" in sentence(full)
        assert (await trainer.http.post("/episodes", json={"scene": 7, "count": 2})).status_code == 201
        assert trainer.referee.open_episodes == 3


async def test_a_host_without_a_place_is_a_reason_to_wait(
    web_server: Any,
) -> None:
    full = json.dumps({"error": "2 episodes are open, which is the limit; delete some or wait"}).encode()
    with web_server(429, full) as url:
        served = app(Referee(HostConnector(url), KeyRing(), RECORD))
        async with httpx.AsyncClient(transport=httpx.ASGITransport(served), base_url="http://127.0.0.1") as http:
            refused = await http.post("/episodes", json={"scene": 7, "count": 2})
            assert (refused.status_code, refused.headers["retry-after"]) == (429, "5")
            assert "delete some or wait" in sentence(refused)
            assert (await http.get("/healthz")).json()["episodes"] == 0


@pytest.mark.parametrize("count", [0, MOST_IN_GROUP + 1, "3", 1.5])
async def test_a_size_that_no_group_has_is_refused(host_url: str, count: object) -> None:
    async with refereeing(host_url) as trainer:
        refused = await trainer.http.post("/episodes", json={"scene": 7, "count": count})
        assert refused.status_code == 400
        assert sentence(refused).startswith("count: Input should be ")
        refused = await trainer.http.post("/checks", json={"scene": 7, "count": 2})
        assert refused.status_code == 400


async def test_facts_about_a_split_tell_what_a_scene_asks_and_nothing_of_its_key(host_url: str) -> None:
    async with refereeing(host_url, difficulties={7: (-1.5, 0.25)}) as trainer:
        found = (await trainer.http.get("/variants", params={"split": "train"})).json()
        train = splits()["train"]
        assert (found["split"], found["scenes"], found["variants"]) == (train.label, 54, 54 * len(train.seeds))
        facts = {row["scene"]: row for row in found["facts"]}
        assert tuple(facts) == train.scenes
        assert facts[7] == {
            "scene": 7,
            "world": None,
            "level": None,
            "rung": "easy",
            "category": "easy-single",
            "answer_parts": 1,
            "reference_iterations": 2,
            "reference_calls": None,
            "difficulty": -1.5,
            "difficulty_se": 0.25,
            "chance": pytest.approx(0.0109, abs=1e-4),
        }
        assert {row["difficulty"] for scene, row in facts.items() if scene != 7} == {None}
        assert any(row["answer_parts"] > 1 for row in facts.values())
        assert any(row["reference_calls"] for row in facts.values())
        page = (await trainer.http.get("/variants?split=train&offset=50&limit=2")).json()
        assert [row["scene"] for row in page["facts"]] == list(train.scenes[50:52])


@pytest.mark.parametrize(
    ("query", "status", "says"),
    [
        ("", 400, "name a split or a level"),
        ("?split=dev", 404, "there is no split 'dev'"),
        ("?split=train&limit=0", 400, "limit: Input should be greater"),
        ("?split=train&colour=red", 400, "colour: Extra inputs"),
        ("?level=99", 400, "level: Input should be less"),
        ("?split=train&offset=" + "9" * 30, 400, "offset: Input should be less"),
    ],
)
async def test_facts_that_there_are_not_are_refused(host_url: str, query: str, status: int, says: str) -> None:
    async with refereeing(host_url) as trainer:
        refused = await trainer.http.get(f"/variants{query}")
    assert refused.status_code == status
    assert says in sentence(refused)


def test_facts_about_worlds_are_selected_by_level_and_split(tmp_path: Path) -> None:
    worlds = write_worlds(tmp_path, (0, 6))
    known = Variants(KeyRing(worlds), RECORD)
    page = known.listed(WantedVariants(level=1))
    assert [(facts.world, facts.level, facts.rung) for facts in page.facts] == [
        ("world:1:0", 1, "open"),
        ("world:1:6", 1, "open"),
    ]
    assert known.listed(WantedVariants(level=1, split="validation")).facts == page.facts[1:]
    with pytest.raises(RefusedRequest, match="no world here has level 1, terms 5"):
        known.listed(WantedVariants(level=1, terms=5))


async def test_the_counters_are_in_the_format_of_prometheus(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        one, two, three = (await trainer.http.post("/episodes", json={"scene": 7, "count": 3})).json()["episodes"]
        await trainer.reward(one, GIVE_UP)
        await trainer.http.delete(
            f"/episodes/{two['episode_id']}", headers={"Authorization": f"Bearer {two['owner_token']}"}
        )
        trainer.referee.max_wall_s = -1.0
        await trainer.referee.sweep()
        assert (await trainer.reward(three, GIVE_UP)).status_code == 404
        reply = await trainer.http.get("/metrics")
    assert reply.headers["content-type"].startswith("text/plain; version=0.0.4")
    samples = dict(line.rsplit(" ", 1) for line in reply.text.splitlines() if not line.startswith("#"))
    assert samples == {
        "physment_referee_episodes_open": "0",
        "physment_referee_episodes_limit": "1000",
        "physment_referee_episodes_opened_total": "3",
        "physment_referee_episodes_expired_total": "1",
        "physment_referee_episodes_closed_total": "1",
        'physment_referee_rewards_total{outcome="budget_exhausted"}': "1",
        "physment_referee_reward_sum": "0.0",
        'physment_referee_refusals_total{status="404"}': "1",
    }
    assert len(re.findall(r"^# TYPE \w+ (?:gauge|counter)$", reply.text, re.MULTILINE)) == 8


async def test_with_a_token_only_its_holder_reads_facts_and_counters(host_url: str) -> None:
    async with refereeing(host_url, token="secret") as trainer:
        for path in ("/variants?split=train", "/metrics"):
            assert (await trainer.http.get(path)).status_code == 401
            assert (await trainer.http.get(path, headers={"Authorization": "Bearer secret"})).status_code == 200


def test_the_shared_client_opens_groups_and_says_when_to_ask_again(web_server: Any) -> None:
    client = referee_client()
    one = {"episode_id": "e", "owner_token": "o", "mcp_url": "u", "player_token": "p"}
    shared = {"prompt": "", "tools": [], "budget": 20, "scene": 7, "world": None, "split": None, "index": None}
    with web_server(201, json.dumps({**shared, "episodes": [one, one | {"episode_id": "f"}]}).encode()) as url:
        assert [opened.episode_id for opened in client.Referee(url).open_group(2, 7)] == ["e", "f"]
    with web_server(429, b'{"error": "full"}') as url, pytest.raises(client.RefereeError, match="full") as refused:
        client.Referee(url).open(7)
    assert refused.value.retry_after_s is None


def test_the_shared_client_waits_for_a_place_as_long_as_it_was_told(web_server: Any) -> None:
    client = referee_client()
    one = {"episode_id": "e", "owner_token": "o", "mcp_url": "u", "player_token": "p"}
    reply = {"prompt": "", "tools": [], "budget": 20, "scene": 7, "episodes": [one]}
    with web_server(201, json.dumps(reply).encode(), busy=3) as url:
        assert client.Referee(url).open_when_free(60, scene=7).episode_id == "e"
    with web_server(201, json.dumps(reply).encode(), busy=3) as url, pytest.raises(client.RefereeError):
        client.Referee(url).open_when_free(-1, scene=7)
    with web_server(404, b'{"error": "no such scene"}') as url, pytest.raises(client.RefereeError, match="no such"):
        client.Referee(url).open_when_free(60, scene=9999)
