"""Tests of `integrations/` that need no framework.

They check the imports of clients and plugins, the shared client, and its copy of the referee's contract.
"""

import ast
import json
import re
import sys
import tomllib
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Literal, get_args

import pytest
from pydantic import BaseModel, Field

from evaluator.commands.program import parser
from evaluator.episode.player import ANSWER
from evaluator.referee.contract import EndedEpisode, WantedEpisode, WantedGroup
from physment_mcp import open_episode
from tests.builders.paths import ROOT
from tests.builders.referee_client import referee_client

FOLDER = ROOT / "integrations"
PLUGINS = [FOLDER / "harbor", FOLDER / "inspect"]
"""Packages that are installed beside ours, and import our public names."""
CLIENTS = sorted({path.parent for path in FOLDER.glob("*/pyproject.toml")} - set(PLUGINS))
"""Packages that have separate requirements, contain no key, and import none of our packages."""
IN_PROCESS = FOLDER / "trl" / "physment_trl" / "in_process.py"
"""The one module of a client that plays without a host, by public names; the package offers it as an extra."""
OURS = {"physment_mcp", "evaluator", "scenes", "mujoco"}


def requirements(package: Path) -> list[str]:
    return tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))["project"].get("dependencies", [])


def imports(source: str) -> Iterator[tuple[str, str]]:
    """Return the imports of a module: each module with the imported name, or with nothing."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((name.name, "") for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module or "", name.name) for name in node.names)


def imported(package: Path) -> Iterator[tuple[str, str]]:
    for path in sorted(set(package.rglob("*.py")) - {IN_PROCESS}):
        yield from imports(path.read_text(encoding="utf-8"))


def not_public(source: str) -> list[tuple[str, str]]:
    """Return the names that a module imports from this project's packages although they are not public."""
    ours = [(module, name) for module, name in imports(source) if module.partition(".")[0] in OURS]
    return [(module, name) for module, name in ours if module == "mujoco" or not is_public(module, name)]


def is_public(module: str, name: str) -> bool:
    return "." not in module and name in import_module(module).__all__


@pytest.mark.parametrize("package", CLIENTS, ids=lambda package: package.name)
def test_the_client_of_a_framework_imports_nothing_of_ours(package: Path) -> None:
    assert [found for found in imported(package) if found[0].partition(".")[0] in OURS] == []


@pytest.mark.parametrize("package", CLIENTS, ids=lambda package: package.name)
def test_the_client_of_a_framework_has_requirements_of_its_own_and_none_of_ours(package: Path) -> None:
    required = requirements(package)
    assert [one for one in required if one.startswith(("physment-mcp", "mujoco"))] == []
    assert ("physment-referee-client" in required) == (package.name != "client")


@pytest.mark.parametrize("package", PLUGINS, ids=lambda package: package.name)
def test_a_plugin_imports_public_names_alone(package: Path) -> None:
    modules = sorted(package.rglob("*.py"))
    assert {str(path): found for path in modules if (found := not_public(path.read_text(encoding="utf-8")))} == {}
    assert "physment-mcp" in requirements(package)
    assert any(module == "evaluator" for module, _ in imported(package))


def test_the_module_that_plays_in_process_imports_public_names_and_no_other_module_needs_it() -> None:
    assert not_public(IN_PROCESS.read_text(encoding="utf-8")) == []
    assert [found for found in imported(FOLDER / "trl") if "in_process" in found[0]] == []


@pytest.mark.parametrize(
    "source",
    [
        "from evaluator.answers.keys import KeyRing",
        "from evaluator import KeyRing",
        "import evaluator.library",
        "from physment_mcp import session",
        "def f():\n    import mujoco",
    ],
)
def test_a_planted_import_of_a_plugin_is_caught(source: str) -> None:
    assert not_public(source)


def test_the_shared_client_needs_the_standard_library_alone() -> None:
    assert {module.partition(".")[0] for module, _ in imported(FOLDER / "client")} <= sys.stdlib_module_names


def test_the_shared_client_repeats_what_a_referee_reads() -> None:
    """Checks the fields of requests. A test of the referee compares the replies."""
    client = referee_client()
    options = {"split", "world", "budget", "max_calls", "prompting"}
    assert {*client._NUMBERS, *options} == WantedEpisode.model_fields.keys()
    assert client.End in get_args(EndedEpisode.model_fields["end"].annotation)
    assert client.ANSWER == ANSWER
    assert f"http://127.0.0.1:{parser('referee')[1]['referee'].get_default('port')}" == client.URL


def properties(model: type[BaseModel]) -> dict[str, Any]:
    """Return the constraints of each field of a model, without titles; without bounds for numbers of variants."""
    found: dict[str, Any] = {}
    for name, schema in model.model_json_schema()["properties"].items():
        kinds = [{"type": kind.get("type", "object")} for kind in schema.get("anyOf", ())]
        found[name] = {key: value for key, value in schema.items() if key not in {"title", "anyOf"}} | {"anyOf": kinds}
    return found


def copied(file: str, name: str) -> dict[str, Any]:
    """Return the fields that a class of an integration shares with the contract; its framework is not installed."""
    tree = ast.parse((FOLDER / file).read_text(encoding="utf-8"))
    (found,) = (node for node in ast.walk(tree) if isinstance(node, ast.ClassDef) and node.name == name)
    fields = [node for node in found.body if isinstance(node, ast.AnnAssign)]
    fields = [node for node in fields if ast.unparse(node.target) in WantedGroup.model_fields]
    names: dict[str, Any] = {"BaseModel": BaseModel, "Field": Field, "Literal": Literal, "Any": Any}
    exec("class Copy(BaseModel):\n" + "\n".join(f"    {ast.unparse(node)}" for node in fields), names)
    return properties(names["Copy"])


def parameters(file: str, name: str) -> Mapping[str, object]:
    """The parameters of a method with their defaults."""
    tree = ast.parse((FOLDER / file).read_text(encoding="utf-8"))
    (found,) = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name == name)
    named = [argument.arg for argument in found.args.args if argument.arg != "self"]
    return dict(zip(named, map(ast.literal_eval, found.args.defaults), strict=True))


def test_the_clients_of_frameworks_repeat_the_contract_of_a_referee() -> None:
    everything = properties(WantedGroup)
    del everything["count"]  # each rollout opens its own episode
    contract = {
        name: kind for name, kind in everything.items() if name != "max_calls"
    }  # the framework counts iterations
    taskset, server = "verifiers/physment/taskset.py", "nemo_gym/resources_servers/physment/app.py"
    verifiers = copied(taskset, "PhysmentData") | copied(taskset, "PhysmentTaskConfig")
    assert verifiers == contract
    # A row of NeMo Gym contains the prompt, so its variant is known before the training.
    fixed = {name: kind for name, kind in contract.items() if name not in {"prompting", "curriculum"}}
    assert copied(server, "PhysmentVariant") == fixed
    defaults = {name: kind["default"] for name, kind in contract.items()}
    reset = dict(parameters("openenv/server/environment.py", "reset"))
    assert reset.pop("episode_id") is None  # a name that OpenEnv gives
    assert reset == defaults
    assert parameters("trl/physment_trl/environment.py", "reset") == defaults | {
        "max_calls": everything["max_calls"]["default"]
    }


def test_the_tools_of_the_environment_for_trl_are_those_of_the_laboratory(update_goldens: bool) -> None:
    """`pytest tests/test_integrations.py --update-goldens` writes the copy anew."""
    copy = FOLDER / "trl" / "physment_trl" / "tools.json"
    usual, with_law = (
        [
            {"name": tool.name, "description": tool.description, "input_schema": tool.input_schema}
            for tool in open_episode(scene).tools
        ]
        for scene in (7, 201)
    )
    assert with_law[:-1] == usual[:-1]
    tools = {"tools": usual, "answer_with_law": with_law[-1]}
    if update_goldens:
        copy.write_text(json.dumps(tools, indent=1) + "\n", encoding="utf-8")
    assert json.loads(copy.read_text(encoding="utf-8")) == tools


def test_variants_are_scenes_with_seeds_places_in_a_split_or_the_lines_of_a_file(tmp_path: Path) -> None:
    read = referee_client().read_variants
    pairs = [(variant["scene"], variant["seed"]) for variant in read("7,9-10", "1-2")]
    assert pairs == [(7, 1), (9, 1), (10, 1), (7, 2), (9, 2), (10, 2)]
    assert list(read("7")) == [{"scene": 7, "seed": 1}]
    assert list(read(split="train", indices="3-4")) == [{"split": "train", "index": 3}, {"split": "train", "index": 4}]
    assert list(read("7", split="train", random_seeds="5")) == [{"split": "train", "scene": 7, "random_seed": 5}]
    assert list(read("7", "10000", split="train")) == [{"split": "train", "scene": 7, "seed": 10000}]
    file = tmp_path / "pairs.jsonl"
    file.write_text('{"scene": 7, "seed": 3, "note": 1}\n{"split": "test", "index": 0}\n', encoding="utf-8")
    found = list(read(file=file))
    assert found == [{"scene": 7, "seed": 3}, {"split": "test", "index": 0}]
    assert list(map(referee_client().name_of, found)) == ["scene7-seed3", "test-index0"]


def test_variants_are_worlds_of_levels_or_draws_from_a_curriculum(tmp_path: Path) -> None:
    read, name = referee_client().read_variants, referee_client().name_of
    third, fourth = {"world": {"level": 3}}, {"world": {"level": 4}}
    assert list(read(levels="3-4", indices="0")) == [third | {"index": 0}, fourth | {"index": 0}]
    (drawn,) = read(levels="3", split="train", random_seeds="5")
    assert (drawn, name(drawn)) == (third | {"split": "train", "random_seed": 5}, "train-level3-random_seed5")
    of_split, of_level, of_all = (
        next(read(**pool, curriculum="a", random_seeds="1-2")) for pool in ({"split": "train"}, {"levels": "3"}, {})
    )
    assert of_split == {"split": "train", "curriculum": "a", "random_seed": 1}
    assert of_level == third | {"curriculum": "a", "random_seed": 1}
    assert of_all == {"world": {}, "curriculum": "a", "random_seed": 1}
    assert name(of_all) == "a-random_seed1"
    file = tmp_path / "pairs.jsonl"
    file.write_text("\n".join(map(json.dumps, (drawn, of_all))), encoding="utf-8")
    assert list(read(file=file)) == [drawn, of_all]


@pytest.mark.parametrize(
    ("given", "content", "says"),
    [
        ({}, None, "name scenes"),
        ({"split": "train"}, None, "name scenes"),
        ({"scenes": "7-"}, None, "scenes '7-': write whole numbers"),
        ({"scenes": "7", "seeds": "9-1"}, None, "seeds '9-1': write whole numbers"),
        ({"indices": "0-9"}, None, "name a split with indices"),
        ({"split": "train", "indices": "0", "random_seeds": "1"}, None, "name a split with indices"),
        ({"levels": "3"}, None, "name scenes"),
        ({"levels": "3", "scenes": "7", "random_seeds": "1"}, None, "name a split with indices"),
        ({"curriculum": "a", "split": "train", "indices": "1"}, None, "a curriculum draws"),
        ({"curriculum": "a", "levels": "3-4", "random_seeds": "1"}, None, "a curriculum draws"),
        ({}, '{"scene": 7, "seed": 3}\n{"scene": 7}\n', "line 2: write"),
        ({}, '{"split": "train"}\n', "line 1: write"),
        ({}, '{"split": "train", "index": "0"}\n', "line 1: write"),
        ({}, "[]\n", "line 1: write"),
    ],
)
def test_variants_that_cannot_be_read_are_refused_in_one_sentence(
    tmp_path: Path, given: dict[str, str], content: str | None, says: str
) -> None:
    file = tmp_path / "pairs.jsonl"
    file.write_text(content or "", encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(says)) as refused:
        list(referee_client().read_variants(**given, file=file if content else None))
    assert len(str(refused.value).splitlines()) == 1


def test_a_referee_that_cannot_be_reached_is_named_with_what_to_start() -> None:
    module = referee_client()
    for url, says in (("http://127.0.0.1:9", "start `physment-eval referee`"), ("here", "is not the URL of a referee")):
        with pytest.raises(module.RefereeError, match=says):
            module.Referee(url).open(7)
