"""Tests the server in this process, with the referee that PHYSMENT_REFEREE_URL names."""

import os
from collections.abc import Iterator
from unittest.mock import MagicMock

import pytest
from fastapi.testclient import TestClient
from nemo_gym.base_resources_server import BaseResourcesServerConfig
from nemo_gym.server_utils import ServerClient
from physment_nemo_gym.app import PhysmentResourcesServer

RESPONSE = {
    "id": "resp_1",
    "created_at": 0,
    "model": "none",
    "object": "response",
    "output": [],
    "parallel_tool_calls": False,
    "tool_choice": "auto",
    "tools": [],
}
ROW = {
    "responses_create_params": {"input": [{"role": "user", "content": "x"}]},
    "verifier_metadata": {"scene": 7, "seed": 3},
}


@pytest.fixture
def client() -> Iterator[TestClient]:
    assert "PHYSMENT_REFEREE_URL" in os.environ, "start `physment-eval referee` and name its address"
    config = BaseResourcesServerConfig(host="127.0.0.1", port=1, entrypoint="app.py", name="physment")
    server = PhysmentResourcesServer(config=config, server_client=MagicMock(spec=ServerClient))
    with TestClient(server.setup_webserver()) as opened:
        yield opened


def test_a_session_is_an_episode_with_one_reward(client: TestClient) -> None:
    seeded = client.post("/seed_session", json=ROW)
    assert seeded.status_code == 200, seeded.text
    assert '"sim_time":0.1' in client.post("/step", json={"duration": 0.1}).text
    assert "object_99" in client.post("/get_position", json={"object_id": "object_99"}).text
    assert "acknowledged" in client.post("/answer", json={"answer": -1}).text
    found = client.post("/verify", json=ROW | {"response": RESPONSE}).json()
    assert (found["reward"], found["outcome"], found["calls"]) == (0.0, "answered", 3)
    assert client.post("/verify", json=ROW | {"response": RESPONSE}).status_code == 409


def test_an_episode_without_an_answer_has_used_up_its_budget(client: TestClient) -> None:
    client.post("/seed_session", json=ROW)
    found = client.post("/verify", json=ROW | {"response": RESPONSE}).json()
    assert (found["reward"], found["outcome"], found["calls"]) == (0.0, "budget_exhausted", 0)


def test_what_cannot_be_done_is_said_in_one_sentence(client: TestClient) -> None:
    assert "seed_session first" in client.post("/step", json={}).json()["detail"]
    unknown = client.post("/seed_session", json=ROW | {"verifier_metadata": {"scene": 9999}})
    assert (unknown.status_code, "no scene 9999" in unknown.json()["detail"]) == (502, True)
