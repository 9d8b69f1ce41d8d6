"""Tests of the referee over HTTP, with a real host: opening, refusals, and that each reward is given once."""

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import AsyncGenerator
from dataclasses import fields
from datetime import date
from pathlib import Path
from typing import Any

import anyio
import httpx
import httpx2
import pytest

from evaluator.agents.reference import ReferenceAgent
from evaluator.answers.keys import KeyRing
from evaluator.answers.rewards import RewardRule, Worth
from evaluator.episode.hosts import HostConnector, mcp_client
from evaluator.episode.loop import play_episode
from evaluator.records.episode import Episode
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.referee.episodes import Referee
from evaluator.referee.requests import app
from evaluator.scores.scoring import grade_record, grade_run
from evaluator.store.run_folder import RunFolder
from scenes import Erratum, ErratumEffect, find_pack, pack_hash
from tests.builders.hosts import FOREIGN_HOSTS
from tests.builders.records import VERSIONS, episode_key
from tests.builders.referee_client import referee_client
from tests.harness.clients.playing import canonical, exchanges_of

RECORD = RunRecord(
    created_at="2026-01-01T00:00:00+00:00",
    plan=Plan(scenes=(7, 23), agents=("trainer",)),
    server=ServerRecord(option="host", protocol="x"),
    packs={"7": "p", "23": "p"},
    versions={"physment-mcp": "0"},
)
HUGE = "9" * 4000
GIVE_UP = {"end": "budget_exhausted"}


class Trainer:
    """A client of the referee, in the role of a trainer."""

    def __init__(self, referee: Referee, http: httpx.AsyncClient) -> None:
        self.referee, self.http = referee, http

    async def open(self, **wanted: Any) -> dict[str, Any]:
        reply = await self.http.post("/episodes", json={"scene": 7, "seed": 3} | wanted)
        assert reply.status_code == 201, reply.text
        return reply.json()

    async def reward(self, opened: dict[str, Any], body: Any = None, token: str | None = None) -> httpx.Response:
        headers = {"Authorization": f"Bearer {opened['owner_token'] if token is None else token}"}
        return await self.http.post(f"/episodes/{opened['episode_id']}/reward", json=body or {}, headers=headers)


@contextlib.asynccontextmanager
async def refereeing(host_url: str, *, token: str | None = None, **options: Any) -> AsyncGenerator[Trainer]:
    referee = Referee(HostConnector(host_url), KeyRing(), RECORD, **options)
    served = app(referee, token)
    async with (
        served.router.lifespan_context(served),
        httpx.AsyncClient(transport=httpx.ASGITransport(served), base_url="http://127.0.0.1") as http,
    ):
        yield Trainer(referee, http)


async def played_by_reference(opened: dict[str, Any], scene: int, seed: int) -> Episode:
    """Let the reference agent play an episode that a referee opened, by its address and player token."""
    headers = {"Authorization": f"Bearer {opened['player_token']}"}
    key = episode_key(scene, seed=seed, agent="reference", budget=opened["budget"])
    async with httpx2.AsyncClient(headers=headers) as http, mcp_client(opened["mcp_url"], http) as client:
        return await play_episode(ReferenceAgent(), client, key, VERSIONS)


def sentence(reply: httpx.Response) -> str:
    """Return the error message of a refusal."""
    body = reply.json()
    assert set(body) == {"error"}
    assert len(body["error"].splitlines()) == 1
    return body["error"]


async def test_an_episode_has_the_prompt_calls_and_grade_of_the_loop(host_url: str, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.create(resume=False)
    async with refereeing(host_url, folder=folder) as trainer:
        opened = await trainer.open(scene=23, seed=5, budget=12)
        episode = await played_by_reference(opened, 23, 5)
        reply = (await trainer.reward(opened, {"iterations": len(episode.turns)})).json()
    assert opened["prompt"] == episode.prompt
    assert len(opened["tools"]) == 26
    assert reply["reward"] == 1.0
    assert (reply["outcome"], reply["strict"]) == ("answered", "correct")
    (recorded,) = folder.episodes().values()
    assert list(map(canonical, exchanges_of(recorded))) == list(map(canonical, exchanges_of(episode)))
    assert grade_record(recorded, KeyRing()).grade == grade_record(episode, KeyRing()).grade
    assert reply["calls"] == len(exchanges_of(episode))


async def test_a_scene_whose_pack_is_withdrawn_is_not_opened(host_url: str) -> None:
    erratum = Erratum(
        scene=7,
        pack=pack_hash(find_pack(7)),
        effect=ErratumEffect.WITHDRAWN,
        fault="The key is wrong.",
        date=date(2026, 11, 26),
    )
    record = RECORD.model_copy(update={"packs": {"7": erratum.pack, "23": "p"}})
    referee = Referee(HostConnector(host_url), KeyRing(errata=[erratum]), record)
    served = app(referee, None)
    async with httpx.AsyncClient(transport=httpx.ASGITransport(served), base_url="http://127.0.0.1") as http:
        refused = await http.post("/episodes", json={"scene": 7, "seed": 3})
        checked = await http.post("/checks", json={"scene": 7, "seed": 3})
    assert (refused.status_code, checked.status_code) == (404, 404)
    assert sentence(refused) == "scene 7 is withdrawn: The key is wrong."


async def test_replies_have_the_fields_that_the_shared_client_reads(host_url: str) -> None:
    client = referee_client()
    async with refereeing(host_url, shapes=True) as trainer:
        opened = await trainer.open()
        given = (await trainer.reward(opened, GIVE_UP)).json()
    assert opened.keys() == {one.name for one in fields(client.OpenedEpisode)}
    assert given.keys() == {one.name for one in fields(client.Reward)}
    assert [tool.keys() for tool in opened["tools"]] == [{"name", "description", "input_schema"}] * 26


async def test_a_reward_is_given_once(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        opened = await trainer.open()
        assert (await trainer.reward(opened, GIVE_UP)).json()["reward"] == 0.0
        again = await trainer.reward(opened, GIVE_UP)
    assert (again.status_code, sentence(again)) == (
        409,
        "the reward of this episode was given already; it is given once",
    )


async def test_an_unfinished_episode_has_no_reward_and_goes_on(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        opened = await trainer.open()
        early = await trainer.reward(opened)
        assert (early.status_code, sentence(early).partition(":")[0]) == (409, "the episode is still running")
        await played_by_reference(opened, 7, 3)
        assert (await trainer.reward(opened)).json()["reward"] == 1.0


async def test_an_episode_whose_calls_are_used_up_has_ended(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        opened = await trainer.open(max_calls=1)
        await played_by_reference(opened, 7, 3)
        reply = (await trainer.reward(opened)).json()
    assert (reply["reward"], reply["outcome"]) == (0.0, "budget_exhausted")


async def test_the_token_of_the_player_does_not_open_the_reward(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        opened = await trainer.open()
        for token in (opened["player_token"], "", "x"):
            refused = await trainer.reward(opened, GIVE_UP, token)
            assert refused.status_code == 401
            assert "owner_token" in sentence(refused)
        assert (await trainer.reward(opened, GIVE_UP)).status_code == 200


@pytest.mark.parametrize(
    ("body", "status", "says"),
    [
        ('{"scene": 9999}', 404, "no scene 9999"),
        ('{"scene": "7"}', 400, "scene: Input should be a valid integer"),
        ('{"scene": 7, "seed": -1}', 400, "seed: Input should be greater than or equal to 0"),
        ('{"scene": 7, "knobs": 1}', 400, "knobs: Extra inputs are not permitted"),
        ("{", 400, "body: Invalid JSON"),
        (f'{{"scene": {HUGE}}}', 400, "scene: Input should be less than or equal to 18446744073709551615"),
        (f'{{"scene": 7, "seed": {HUGE}}}', 400, "seed: Input should be less than or equal to"),
        (f'{{"scene": 7, "seed": {HUGE}{HUGE}}}', 400, "body: Invalid JSON: number out of range"),
        (f'{{"split": "train", "index": {HUGE}}}', 400, "index: Input should be less than or equal to"),
        (f'{{"split": "train", "random_seed": -{HUGE}}}', 400, "random_seed: Input should be greater than or equal to"),
        (f'{{"split": "train", "random_seed": {HUGE}}}', 400, "random_seed: Input should be less than or equal to"),
        ('{"scene": 1e400}', 400, "scene: Input should be a valid integer"),
        ('{"scene": NaN}', 400, "scene: Input should be a valid integer"),
        ('{"scene": 7, "budget": -Infinity}', 400, "budget: Input should be a valid integer"),
        (f'{{"scene": {"[" * 7000}{"]" * 7000}}}', 400, "body: Invalid JSON: recursion limit exceeded"),
        ('{"a":' * 2000 + "1" + "}" * 2000, 400, "body: Invalid JSON"),
        (f'{{"{"k" * 15_000}": 1}}', 400, "kkkk: Extra inputs are not permitted"),
        ("", 400, "names no variant"),
        (f'{{"scene": 7, "prompting": "{"x" * 20_000}"}}', 413, "a request has at most 16000 bytes"),
    ],
)
async def test_what_cannot_be_opened_is_refused_in_one_sentence(
    host_url: str, body: str, status: int, says: str
) -> None:
    async with refereeing(host_url) as trainer:
        refused = await trainer.http.post("/episodes", content=body)
        assert refused.status_code == status
        assert says in sentence(refused)
        assert len(refused.text) < 600
        assert trainer.referee.open_episodes == 0


@pytest.mark.parametrize("iterations", ["-1", "1000001", HUGE, "1e400", "NaN", "7.5", "[[[[1]]]]"])
async def test_a_number_of_iterations_that_cannot_be_is_refused_in_one_sentence(host_url: str, iterations: str) -> None:
    async with refereeing(host_url, rule=RewardRule(per_iteration=0.1)) as trainer:
        opened = await trainer.open()
        headers = {"Authorization": f"Bearer {opened['owner_token']}"}
        body = f'{{"iterations": {iterations}, "end": "budget_exhausted"}}'
        refused = await trainer.http.post(f"/episodes/{opened['episode_id']}/reward", content=body, headers=headers)
        assert refused.status_code == 400
        assert sentence(refused).startswith("iterations: Input should be ")
        assert len(refused.text) < 300
        assert (await trainer.reward(opened, GIVE_UP | {"iterations": 1})).status_code == 200


async def test_an_episode_that_never_was_is_refused_in_one_sentence(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        refused = await trainer.reward({"episode_id": "none", "owner_token": "none"})
    assert refused.status_code == 404
    assert "there is no such episode" in sentence(refused)


async def test_neither_the_seed_nor_the_key_is_in_what_a_trainer_gets(host_url: str) -> None:
    key = KeyRing().key(7, 41_287).value
    async with refereeing(host_url) as trainer:
        opened = await trainer.open(seed=41_287)
        told = {"episode_id", "owner_token", "mcp_url", "player_token", "prompt", "budget", "tools"}
        assert set(opened) == told | {"scene", "world", "split", "index"}
        assert "41287" not in json.dumps(opened)
        await played_by_reference(opened, 7, 41_287)
        rewarded = await trainer.reward(opened)
    assert set(rewarded.json()) == {
        *("reward", "strict", "graded", "normalised", "outcome", "calls", "parts", "chance", "cost"),
    }
    assert str(key)[:6] not in rewarded.text


async def test_shaping_rewards_the_calls_that_lower_the_bound_and_adds_up_to_nothing(host_url: str) -> None:
    async with refereeing(host_url, shapes=True) as trainer:
        opened = await trainer.open(seed=3)
        played = await played_by_reference(opened, 7, 3)
        found = (await trainer.reward(opened)).json()["shaping"]
    tools = [exchange.call.tool for turn in played.turns for exchange in turn.exchanges]
    assert len(found) == len(tools)
    for tool, reward in zip(tools, found, strict=True):
        assert (reward > 1) == (tool not in {"step", "answer"}), tool
    assert found[-1] < 0
    assert sum(found) == pytest.approx(0, abs=1e-9)


async def test_no_more_episodes_are_open_than_allowed(host_url: str) -> None:
    async with refereeing(host_url, max_episodes=1) as trainer:
        opened = await trainer.open()
        full = await trainer.http.post("/episodes", json={"scene": 7})
        assert (full.status_code, sentence(full)[:15]) == (429, "1 episodes are ")
        owner = {"Authorization": f"Bearer {opened['owner_token']}"}
        assert (await trainer.http.delete(f"/episodes/{opened['episode_id']}", headers=owner)).status_code == 204
        assert (await trainer.http.get("/healthz")).json() == {"status": "ok", "episodes": 0}
        await trainer.open()


async def test_an_episode_that_nobody_asked_about_is_closed_here_and_on_the_host(host_url: str) -> None:
    async with refereeing(host_url) as trainer, httpx2.AsyncClient(base_url=host_url) as http:
        opened = await trainer.open()
        before = (await http.get("/healthz")).json()["episodes"]
        await trainer.referee.sweep()
        assert (await http.get("/healthz")).json()["episodes"] == before
        trainer.referee.max_wall_s = 0.0
        await trainer.referee.sweep()
        assert (await http.get("/healthz")).json()["episodes"] == before - 1
        assert (await trainer.reward(opened, GIVE_UP)).status_code == 404


async def test_an_episode_that_its_host_lost_is_not_the_agents_fault(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        opened = await trainer.open()
        watched = trainer.referee._open[opened["episode_id"]].watched
        async with httpx2.AsyncClient(base_url=host_url) as http:
            owner = {"Authorization": f"Bearer {watched._owner_token}"}
            assert (await http.delete(watched._path, headers=owner)).status_code == 204
        lost = await trainer.reward(opened, GIVE_UP)
    assert lost.status_code == 502
    assert "says nothing about the agent" in sentence(lost)


async def test_without_a_token_web_pages_and_other_machines_are_refused(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        assert (await trainer.http.get("/healthz", headers={"Origin": "http://127.0.0.1"})).status_code == 403
        for name in FOREIGN_HOSTS:
            refused = await trainer.http.get("/healthz", headers=[(b"Host", name.encode("latin-1"))])
            assert refused.status_code == 403, name
        assert (await trainer.http.get("/healthz", headers={"Host": "LOCALHOST:80"})).status_code == 200


async def test_a_referee_with_a_token_opens_and_checks_only_with_it(host_url: str) -> None:
    async with refereeing(host_url, token="ours") as trainer:
        for path in ("/episodes", "/checks"):
            for headers in ({}, {"Authorization": "Bearer theirs"}):
                refused = await trainer.http.post(path, json={"scene": 7}, headers=headers)
                assert (refused.status_code, "bearer token" in sentence(refused)) == (401, True)
        right = {"Authorization": "Bearer ours", "Host": "lab.example"}
        assert (await trainer.http.post("/episodes", json={"scene": 7}, headers=right)).status_code == 201


async def test_a_check_lets_the_reference_play(host_url: str) -> None:
    async with refereeing(host_url) as trainer:
        reply = await trainer.http.post("/checks", json={"scene": 23, "seed": 9})
        assert (reply.json()["reward"], reply.json()["outcome"]) == (1.0, "answered")
        assert trainer.referee.open_episodes == 0


async def test_what_iterations_cost_is_taken_off_and_they_must_be_told(host_url: str) -> None:
    async with refereeing(host_url, rule=RewardRule(per_iteration=0.125, per_call=0.25)) as trainer:
        opened = await trainer.open()
        refused = await trainer.reward(opened, GIVE_UP)
        assert (refused.status_code, "how many" in sentence(refused)) == (400, True)
        episode = await played_by_reference(opened, 7, 3)
        calls = len(exchanges_of(episode))
        assert (await trainer.reward(opened, {"iterations": 2})).json()["reward"] == 1 - 2 * 0.125 - calls * 0.25


async def test_a_reward_tells_its_parts_its_chance_and_its_cost(host_url: str) -> None:
    rule = RewardRule(Worth.CHANCE_CORRECTED, per_call=0.25)
    async with refereeing(host_url, rule=rule) as trainer:
        opened = await trainer.open()
        episode = await played_by_reference(opened, 7, 3)
        right = (await trainer.reward(opened, {"iterations": 2})).json()
        given_up = (await trainer.reward(await trainer.open(), GIVE_UP)).json()
    calls = len(exchanges_of(episode))
    assert (right["parts"], right["cost"], right["reward"]) == ([True], 0.25 * calls, 1 - 0.25 * calls)
    chance = given_up["chance"]
    assert 0 < chance < 0.05
    assert given_up["parts"] == [False]
    assert given_up["reward"] == pytest.approx(-chance / (1 - chance))


async def test_graded_episodes_are_a_run_that_can_be_graded_again(host_url: str, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.create(resume=False)
    async with refereeing(host_url, folder=folder) as trainer:
        for _ in range(2):
            opened = await trainer.open()
            await played_by_reference(opened, 7, 3)
            await trainer.reward(opened)
        await trainer.reward(await trainer.open(seed=4, budget=5), {"end": "agent_error"})
        plan = trainer.referee.played_record().plan
    assert (plan.scenes, plan.seeds, plan.budgets, plan.epochs) == ((7,), (3, 4), (5, 20), 2)
    summary = grade_run(folder, KeyRing()).summary
    assert (summary.overall.n_correct, summary.overall.n_scored) == (2, 3)


async def test_episodes_that_are_graded_together_are_all_recorded(host_url: str, tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.create(resume=False)
    async with refereeing(host_url, folder=folder) as trainer:
        opened = [await trainer.open() for _ in range(4)]
        async with anyio.create_task_group() as tasks:
            for one in opened:
                tasks.start_soon(trainer.reward, one, GIVE_UP)
    assert sorted(key.epoch for key in folder.episodes()) == [1, 2, 3, 4]


def test_the_command_serves_until_it_is_ended_and_leaves_a_sealed_run(host_url: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "evaluator", "referee", "--server", host_url, "--port", "0"]
    with subprocess.Popen(
        [*command, "--out", str(tmp_path / "run")], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        address = json.loads(process.stdout.readline())["listening"]
        referee = referee_client().Referee(address)
        opened = referee.open(7, 3, budget=4)
        assert (opened.budget, len(opened.tools)) == (4, 26)
        given = referee.reward(opened.episode_id, opened.owner_token, iterations=4, end="budget_exhausted")
        assert (given.reward, given.outcome) == (0.0, "budget_exhausted")
        with pytest.raises(referee_client().RefereeError, match="given already"):
            referee.close(opened.episode_id, opened.owner_token)
        assert referee.check(7, 3).reward == 1.0
        process.send_signal(signal.SIGTERM)
        _, errors = process.communicate(timeout=120)
    assert process.returncode == 130
    assert "seal: 1 episodes" in errors
    assert "Traceback" not in errors
    folder = RunFolder(tmp_path / "run")
    seal = folder.read_seal()
    assert seal is not None
    assert seal.problem(folder.episode_lines()) == ""
    assert folder.read_run().plan.scenes == (7,)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--host", "0.0.0.0"], "put a secret into an environment variable"),
        (["--token-env", "PHYSMENT_NO_SUCH_VARIABLE"], "holds no token"),
        (["--server", "stdio", "--port", "0"], "needs a laboratory with an address"),
        (["--server", "http://127.0.0.1:9", "--port", "0"], "cannot be reached"),
        (["--cost-per-call", "-1"], "is not a cost"),
    ],
)
def test_the_command_says_in_one_sentence_what_it_cannot_use(words: list[str], says: str) -> None:
    from tests.builders.commands import physment_eval

    assert "PHYSMENT_NO_SUCH_VARIABLE" not in os.environ
    done = physment_eval("referee", *words)
    assert done.returncode == 2
    assert says in done.stderr.splitlines()[-1]
