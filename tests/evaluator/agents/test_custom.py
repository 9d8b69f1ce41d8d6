"""Tests of agents that users write in Python: loading, refusals, and handling of their exceptions."""

import contextlib
import json
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from evaluator.agents.custom import load_agent
from evaluator.commands.program import main
from evaluator.errors import UsageError
from evaluator.records.episode import Outcome
from evaluator.store.run_folder import RunFolder

GOOD = """
from evaluator import Reply, ToolCall

class Guesser:
    name = "guesser"
    def player(self, key, briefing):
        return self
    async def act(self, feedback):
        return Reply("I guess.", (ToolCall(tool="answer", arguments={"answer": 1.0}),))

class Owner(Guesser):
    name = "owner"
    events = []
    def facts(self):
        return {"temperature": 0.5}
    async def __aenter__(self):
        self.events.append("opened")
    async def __aexit__(self, *details):
        self.events.append("closed")

class Failing(Guesser):
    name = "failing"
    async def act(self, feedback):
        return {}["mass"]

class Silent(Guesser):
    name = "silent"
    async def act(self, feedback):
        return "answer 5"

class Unplayable(Guesser):
    name = "unplayable"
    def player(self, key, briefing):
        raise RuntimeError("no weights")

class Nameless:
    pass

class Broken:
    def __init__(self):
        raise ValueError("no key")
"""


@pytest.fixture
def folder(tmp_path: Path) -> Generator[Path]:
    """Create a working folder with a module of agents, and unload the module afterwards."""
    (tmp_path / "my_agents.py").write_text(GOOD, encoding="utf-8")
    (tmp_path / "needy.py").write_text("import a_library_nobody_has\n", encoding="utf-8")
    (tmp_path / "torn.py").write_text("class Half(\n", encoding="utf-8")
    paths = list(sys.path)
    with contextlib.chdir(tmp_path):
        yield tmp_path
    sys.path[:] = paths
    for name in ("my_agents", "needy", "torn"):
        sys.modules.pop(name, None)


def run(folder: Path, server: str, agent: str) -> RunFolder:
    main(["--agent", agent, "--scenes", "7", "--server", server, "--out", str(folder / "out")])
    return RunFolder(folder / "out")


def test_a_class_of_a_module_in_the_working_folder_plays(folder: Path, host_url: str) -> None:
    stored = run(folder, host_url, "my_agents:Guesser")
    (episode,) = stored.episodes().values()
    assert episode.outcome is Outcome.ANSWERED
    assert episode.key.agent == "guesser"
    assert episode.answer == 1.0


def test_the_class_and_the_hash_of_its_source_are_in_the_run_record(folder: Path) -> None:
    facts = load_agent("my_agents:Guesser").facts()
    assert facts["class"] == "my_agents:Guesser"
    (folder / "my_agents.py").write_text(GOOD + "\n# another version\n", encoding="utf-8")
    assert load_agent("my_agents:Guesser").facts()["source"] != facts["source"]


def test_an_agent_adds_facts_of_its_own_and_is_closed_after_the_run(folder: Path, host_url: str) -> None:
    run(folder, host_url, "my_agents:Owner")
    agents = json.loads((folder / "out" / "run.json").read_text(encoding="utf-8"))["agents"]
    assert agents["owner"]["temperature"] == 0.5
    assert sys.modules["my_agents"].Owner.events == ["opened", "closed"]


@pytest.mark.parametrize(
    ("agent", "sentence"),
    [
        ("Failing", "failing: act() failed: KeyError: 'mass' (my_agents.py, line 24)"),
        ("Silent", "silent: act() returned str, not a Reply"),
        ("Unplayable", "unplayable: player() failed: RuntimeError: no weights (my_agents.py, line 34)"),
    ],
)
def test_an_exception_of_the_agent_ends_its_episode_and_is_recorded(
    folder: Path, host_url: str, agent: str, sentence: str
) -> None:
    (episode,) = run(folder, host_url, f"my_agents:{agent}").episodes().values()
    assert episode.outcome is Outcome.AGENT_ERROR
    assert episode.error == sentence


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("nowhere:Agent", "there is no such agent, and no module nowhere here"),
        ("my_agents:Nobody", "the module my_agents has no class Nobody"),
        ("my_agents:Nameless", "Nameless needs a `name` (a string) and a method `player(key, briefing)`"),
        ("my_agents:Broken", "Broken() failed: ValueError: no key (my_agents.py, line 41)"),
        ("needy:Agent", "importing needy needs a_library_nobody_has, which is missing"),
        ("torn:Half", "the module torn cannot be imported: SyntaxError"),
    ],
)
def test_what_cannot_be_loaded_is_refused_in_one_sentence(folder: Path, text: str, sentence: str) -> None:
    with pytest.raises(UsageError) as refusal:
        load_agent(text)
    assert sentence in str(refusal.value)
