"""Tests that a referee opens stored worlds by level, parts and split, and explains what it cannot open."""

from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import httpx2
import pytest

from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import connect
from evaluator.episode.hosts import HostConnector, mcp_client
from evaluator.errors import RefusedRequest
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.referee.contract import Variant, WantedEpisode
from evaluator.referee.episodes import Referee
from evaluator.referee.requests import app
from evaluator.referee.selection import variant_of
from evaluator.store.run_folder import RunFolder
from scenes.world_names import scene_id_of
from scenes.worlds.reference import WorldSolution
from tests.builders.worlds import write_worlds

TRAIN, VALIDATION, TEST = 0, 6, 8
"""Indexes of worlds of these splits."""


@pytest.fixture(scope="module")
def worlds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_worlds(tmp_path_factory.mktemp("worlds"), (TRAIN, VALIDATION, TEST))


def wanted(worlds: Path, **values: object) -> Variant:
    return variant_of(WantedEpisode.model_validate(values), held_back=False, folder=worlds)


def test_a_world_is_drawn_or_named_by_its_place(worlds: Path) -> None:
    ids = {scene_id_of(1, index) for index in (TRAIN, VALIDATION, TEST)}
    assert {wanted(worlds, world={"level": 1}).scene for _ in range(50)} == ids
    drawn = wanted(worlds, world={"level": 1}, random_seed=5)
    assert (
        drawn
        == wanted(worlds, world={"level": 1}, random_seed=5)
        == wanted(worlds, world={"level": 1}, index=drawn.index)
    )
    assert drawn.split == ""
    assert wanted(worlds, world={"level": 1}, index=4) == Variant(scene_id_of(1, VALIDATION), 1, "", 4)
    assert wanted(worlds, world={"terms": 1}, index=0).scene in ids


@pytest.mark.parametrize(("split", "index"), [("train", TRAIN), ("validation@1", VALIDATION), ("test", TEST)])
def test_a_split_has_the_worlds_of_its_structures_at_its_seeds(worlds: Path, split: str, index: int) -> None:
    found = wanted(worlds, world={"level": 1}, split=split, index=0)
    assert found.scene == scene_id_of(1, index)
    assert found.split == f"{split.partition('@')[0]}@1"
    assert found.seed == {"train": 10_000, "validation@1": 1000, "test": 0}[split]


@pytest.mark.parametrize(
    ("values", "status", "sentence"),
    [
        ({"world": {"level": 1, "terms": 3}}, 404, "no world here has level 1, terms 3"),
        ({"world": {"level": 5}}, 404, "there are no worlds of level 5 here"),
        ({"world": {"level": 1}, "scene": 7}, 400, "name one of index and random_seed, or neither"),
        ({"world": {"level": 1}, "index": 0, "random_seed": 1}, 400, "name one of index and random_seed, or neither"),
        ({"world": {"level": 1}, "split": "held-back"}, 404, "no world here has level 1 in the split held-back"),
        ({"world": {"level": 1}, "split": "test-open"}, 404, "the split test-open has no worlds"),
        ({"world": {"level": 1}, "split": "dev"}, 404, "there is no split 'dev'"),
        ({"world": {"level": 1}, "index": 3_000_000}, 404, "has 3000000 variants"),
    ],
)
def test_what_cannot_be_opened_is_said(worlds: Path, values: dict[str, Any], status: int, sentence: str) -> None:
    with pytest.raises(RefusedRequest, match=sentence) as refused:
        wanted(worlds, **values)
    assert refused.value.status == status


@asynccontextmanager
async def _refereeing(
    worlds: Path, out: Path, *, shapes: bool = False
) -> AsyncGenerator[tuple[Referee, httpx.AsyncClient]]:
    record = RunRecord(
        created_at="2026-01-01T00:00:00+00:00",
        plan=Plan(scenes=(), agents=("trainer",)),
        server=ServerRecord(option="host", protocol="x"),
        versions={"physment-mcp": "0"},
    )
    folder = RunFolder(out)
    folder.create(resume=False)
    async with connect("host", worlds) as host:
        assert isinstance(host, HostConnector)
        referee = Referee(host, KeyRing(worlds), record, folder=folder, shapes=shapes)
        served = app(referee)
        async with (
            served.router.lifespan_context(served),
            httpx.AsyncClient(transport=httpx.ASGITransport(served), base_url="http://127.0.0.1") as http,
        ):
            yield referee, http


async def test_an_episode_of_a_world_is_opened_checked_and_recorded(worlds: Path, tmp_path: Path) -> None:
    async with _refereeing(worlds, tmp_path / "run") as (referee, http):
        opened = await http.post("/episodes", json={"world": {"level": 1}, "split": "test"})
        assert opened.status_code == 201
        assert (opened.json()["scene"], opened.json()["world"]) == (scene_id_of(1, TEST), "world:1:8")
        headers = {"authorization": f"Bearer {opened.json()['owner_token']}"}
        ended = await http.post(
            f"/episodes/{opened.json()['episode_id']}/reward", json={"end": "agent_error"}, headers=headers
        )
        assert ended.json()["reward"] == 0
        checked = await http.post("/checks", json={"world": {"level": 1}, "index": 0})
        assert checked.json()["reward"] == 1
        record = referee.played_record()
        assert record.plan.scenes == (scene_id_of(1, TEST),)
        assert record.worlds["world:1:8"].split == "test"
        for body in ({"world": {"level": 11}}, {"world": {"colour": 1}}, {"world": 5}, {"world": {"level": "5"}}):
            refused = await http.post("/episodes", json=body)
            assert refused.status_code == 400
            assert refused.json()["error"].startswith("world")


async def test_shaping_rewards_the_readings_in_a_world_and_fits_no_rivals(
    worlds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("fits that change no reward")

    monkeypatch.setattr(WorldSolution, "rivals", fail)
    body = {"object_id": "object_1"}
    calls = [
        ("apply_torque", body | {"torque_vector": [0.0, 0.0, 2.0]}),
        ("step", {"duration": 2.0}),
        ("get_position", body),
        ("get_position", {"object_id": "object_9"}),
        ("step", {"duration": 2.0}),
        ("get_velocity", body),
        ("step", {"duration": 2.0}),
    ]
    async with _refereeing(worlds, tmp_path / "run", shapes=True) as (_, http):
        opened = (await http.post("/episodes", json={"world": {"level": 1}, "index": 0})).json()
        player = {"Authorization": f"Bearer {opened['player_token']}"}
        async with httpx2.AsyncClient(headers=player) as http2, mcp_client(opened["mcp_url"], http2) as client:
            for tool, arguments in calls:
                await client.call_tool(tool, arguments)
        owner = {"Authorization": f"Bearer {opened['owner_token']}"}
        ended = await http.post(f"/episodes/{opened['episode_id']}/reward", json={"end": "agent_error"}, headers=owner)
    shaping = ended.json()["shaping"]
    assert len(shaping) == len(calls)
    assert [reward > 0.1 for reward in shaping[:-1]] == [False, False, True, False, False, True]
    assert sum(shaping) == pytest.approx(0, abs=1e-9)
