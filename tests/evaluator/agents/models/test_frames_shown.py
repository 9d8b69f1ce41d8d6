"""Tests of the images that a model receives with results, in the wire format of each provider."""

import base64
import json
from typing import Any

import pytest

from evaluator.agents.models.agent import ModelAgent
from evaluator.agents.models.choice import parse_model
from evaluator.episode.loop import play_episode
from evaluator.records.episode import Outcome
from physment_mcp.serving.views import Painter
from tests.builders.frames import open_painter, watched_scene
from tests.builders.providers import Service
from tests.builders.records import VERSIONS, episode_key

painter = pytest.fixture(scope="module")(open_painter)


@pytest.mark.parametrize("protocol", ["native", "text"])
async def test_a_model_is_shown_the_picture_after_the_call_it_came_with(
    service: Service, painter: Painter, protocol: str
) -> None:
    calls = [("step", {"duration": 0.1}), ("get_velocity", {"object_id": "object_1"})]
    done: list[tuple[str, Any]] = [("answer", {"answer": 1})]
    if protocol == "native":
        service.say("", calls)
        service.say("", done)
    else:
        for batch in (calls, done):
            listed = [{"tool": tool, "parameters": given} for tool, given in batch]
            service.say(f"```json\n{json.dumps(listed)}\n```")
    text = f"model:{service.dialect.name}:{service.dialect.model}"
    async with (
        ModelAgent(parse_model(text, environ=service.environ)) as agent,
        watched_scene(painter) as client,
    ):
        played = await play_episode(agent, client, episode_key(agent=text, protocol=protocol), VERSIONS)
    assert played.outcome is Outcome.ANSWERED
    (picture,) = played.turns[0].exchanges[0].frames
    sent = json.dumps(service.seen[1].body)
    assert sent.count("Picture after call 1, step:") == 1
    # Providers differ in the alphabet of base64.
    assert base64.b64encode(picture.png).decode() in sent or base64.urlsafe_b64encode(picture.png).decode() in sent
    assert "Picture after" not in json.dumps(service.seen[0].body)
