"""Tests with the real TRL: its trainer plays the laboratory, gets the rewards, and makes a step of GRPO on them."""

import json
from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

from tests.harness.clients.playing import exchanges_of
from tests.integrations.playing import Stand, check_same, place_of, rehearsed, standing

PROGRAM = Path(__file__).parent / "programs" / "trl_step.py"
QUIET = {"TRL_EXPERIMENTAL_SILENCE": "1", "HF_HUB_OFFLINE": "1", "TOKENIZERS_PARALLELISM": "false"}


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stand]:
    with standing("trl", tmp_path_factory.mktemp("trl")) as stand:
        yield stand


def step(stand: Stand, model: str, backend: str, budget: int, *rows: dict[str, Any]) -> dict[str, Any]:
    """Train for one step with groups of 4; returns what the program printed."""
    done = stand.run("python", PROGRAM, model, backend, 4, budget, *map(json.dumps, rows), **QUIET)
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1])


def said(stand: Stand, code: str, **variables: str) -> list[str]:
    """Run code in the environment of TRL; returns the lines that it printed."""
    done = stand.run("python", "-c", code, **QUIET, **variables)
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout.splitlines()


def test_a_step_of_grpo_gets_the_rewards_of_the_same_episodes_as_here(stand: Stand) -> None:
    """Half of each group plays the reference, half answers 0 at once."""
    found = step(stand, stand.model, "referee", 20, {"scene": 23, "seed": 5}, {"scene": 20, "seed": 3})
    assert found["rewards"] == [1.0, 1.0, 0.0, 0.0] * 2
    assert found["changed"]
    log = found["log"]
    assert (log["rewards/PhysMent/mean"], log["reward"]) == (0.5, 0.5)
    recorded = stand.folder.episodes()
    played = [episode for key, episode in recorded.items() if (key.scene, key.seed) == (23, 5)]
    assert len(played) == 4
    assert [episode.answer for episode in played].count(0) == 2
    for scene, seed in ((23, 5), (20, 3)):
        ours = rehearsed(scene, seed)
        same = [
            episode
            for key, episode in recorded.items()
            if (key.scene, key.seed) == (scene, seed) and episode.answer == ours.answer
        ]
        assert len(same) == 2
        for episode in same:
            check_same(episode, ours)
    assert log["tools/failure_frequency"] == 0


def test_a_step_in_process_gets_the_same_rewards_without_a_referee(stand: Stand) -> None:
    before = len(stand.folder.episodes())
    row = {"split": "train", "index": place_of(23, 10_004)}
    found = step(stand, stand.model, "process", 20, row)
    assert found["rewards"] == [1.0, 1.0, 0.0, 0.0]
    assert (found["changed"], found["log"]["rewards/InProcessPhysMent/mean"]) == (True, 0.5)
    assert len(stand.folder.episodes()) == before


def test_the_budget_ends_an_episode_without_a_reward(stand: Stand) -> None:
    found = step(stand, stand.model, "referee", 4, {"scene": 23, "seed": 9})
    assert found["rewards"] == [0.0] * 4
    ours = rehearsed(23, 9, budget=4)
    cut = [episode for key, episode in stand.folder.episodes().items() if (key.seed, key.budget) == (9, 4)]
    assert sorted(episode.outcome for episode in cut) == ["answered"] * 2 + ["budget_exhausted"] * 2
    for episode in cut:
        if episode.outcome == "budget_exhausted":
            check_same(episode, ours)


def test_a_model_that_samples_for_itself_makes_a_step_and_earns_nothing(stand: Stand) -> None:
    found = step(stand, "random", "process", 2, {"scene": 7, "seed": 1})
    assert found["rewards"] == [0.0] * 4


def test_every_tool_has_the_schema_of_the_laboratory_for_transformers(stand: Stand) -> None:
    code = """if True:
        import json
        from physment_trl import PhysMent
        from physment_trl.methods import ANSWER_WITH_LAW, TOOLS
        from transformers.utils import get_json_schema
        env, of_laws = PhysMent(), PhysMent(law=True)
        for env, tool in [*((env, tool) for tool in TOOLS), (of_laws, ANSWER_WITH_LAW)]:
            made, ours = get_json_schema(getattr(env, tool["name"]))["function"], tool["input_schema"]
            theirs = made["parameters"]
            assert made["description"] == " ".join(tool["description"].split()), tool["name"]
            assert theirs.get("required", []) == ours.get("required", []), tool["name"]
            assert list(theirs["properties"]) == list(ours["properties"]), tool["name"]
            for name, one in ours["properties"].items():
                found = theirs["properties"][name]
                assert found["description"] == " ".join(one["description"].split()), name
                assert found.get("type") == one["type"] if "type" in one else {"type", "anyOf"} & set(found), name
        assert [*theirs["properties"]] == ["answer", "steps", "law"]
        print(len(TOOLS))
    """
    assert said(stand, code) == ["26"]


def test_a_law_is_given_with_the_answer_where_it_is_asked_for(stand: Stand) -> None:
    code = """if True:
        import json
        from physment_trl import PhysMent
        from physment_trl.in_process import InProcessPhysMent
        law = {"acceleration": {"object_1": {"x": "object_1_push_x/1.2"}}}
        for kind in (PhysMent, InProcessPhysMent):
            env = kind(law=True)
            env.reset(scene=7)
            print(type(env).__name__, env.answer(answer=1, law=law))
            env.reset(scene=201, seed=2)
            print(env.answer(answer=1, law={"acceleration": {"object_1": {"x": "nobody"}}}))
            print(json.loads(env.answer(answer=1, law=law))["acknowledged"], env.get_reward())
    """
    lines = said(stand, code)
    assert [line.replace("InProcess", "") for line in lines[3:]] == lines[:3]
    assert lines[0] == "PhysMent answer: there is no argument 'law'; the arguments are answer, steps"
    assert lines[1].startswith("answer: law: ")
    assert lines[2] == "True 0.0"
    (recorded,) = (episode for key, episode in stand.folder.episodes().items() if (key.scene, key.seed) == (201, 2))
    given = exchanges_of(recorded)[-1].call.arguments
    assert given["law"] == {"acceleration": {"object_1": {"x": "object_1_push_x/1.2"}}}


@pytest.mark.parametrize("backend", ["physment_trl.PhysMent", "physment_trl.in_process.InProcessPhysMent"])
def test_an_accepted_answer_ends_the_episode_and_fixes_the_reward(stand: Stand, backend: str) -> None:
    module, _, name = backend.rpartition(".")
    code = f"""if True:
        import json
        from {module} import {name}
        from physment_trl.environment import CLOSED
        env = {name}()
        for seed in (0, 3):
            prompt = env.reset(scene=7, seed=seed, split=None, world={{"level": None}}, prompt="ignored", budget=None)
            print(json.dumps([prompt.splitlines()[2], prompt.splitlines()[-1][:27]]))
            print(env.get_velocity(object_id="object_9"))
            print(env.step(duration=-1))
            print(env.step(duration=0.8))
            speed = json.loads(env.get_velocity(object_id="object_1"))["velocity"][2]
            print(env.answer(answer=-speed))
            assert env.step(duration=1) == env.answer(answer=1) == env.find_objects() == CLOSED
            print(env.get_reward(), env.get_reward())
        env.reset(scene=7)
        print(env.get_reward())
        env.reset(scene=7, max_calls=1)
        env.step(duration=0.1)
        print(env.step(duration=0.1), env.get_reward())
    """
    lines = said(stand, code)
    assert lines[0] == lines[6] == '["# Scene: Speed of a dropped ball", "You have 20 iterations. An "]'
    assert "there is no object 'object_9'" in lines[1]
    assert "duration" in lines[2]
    assert json.loads(lines[3])["sim_time"] == 0.8
    assert json.loads(lines[4])["acknowledged"] is True
    assert lines[5] == lines[11] == "1.0 1.0"
    assert lines[12] == "0.0"
    assert lines[13].endswith(" 0.0")


def test_both_backends_return_the_same_texts(stand: Stand) -> None:
    code = """if True:
        from physment_trl import PhysMent
        from physment_trl.in_process import InProcessPhysMent
        told = []
        for kind in (PhysMent, InProcessPhysMent):
            env = kind()
            texts = [env.reset(scene=20, seed=4, prompting="one-shot-cot")]
            texts += [env.find_objects(), env.step(duration=0.5), env.step(), env.step(duration="x")]
            texts += [env.get_position(object_id=1), env.move_object(object_id=1, x=1e9, y=0, z=0), env.step(a=1, b=2)]
            told.append([*texts, env.answer(answer=[1, "two"]), env.get_reward()])
        for one, other in zip(*told):
            assert one == other, (one, other)
        print(len(told[0]))
    """
    assert said(stand, code) == ["10"]


def test_a_lost_episode_has_no_reward_and_trl_leaves_it_out(stand: Stand) -> None:
    code = """if True:
        from physment_referee import Referee
        from physment_trl import PhysMent
        from physment_trl.environment import EpisodeLost
        env = PhysMent()
        env.reset(scene=7)
        opened = env._episode._opened
        Referee.from_environment().close(opened.episode_id, opened.owner_token)
        for tool in (env.find_objects, env.find_objects):
            try:
                tool()
            except EpisodeLost as error:
                print(str(error)[:20])
        print(env.get_reward())
        env.reset(scene=7)
        print(env.get_reward())
    """
    lost, again, reward, next_reward = said(stand, code)
    assert lost.startswith("the host")
    assert (again, reward, next_reward) == ("no episode is open: ", "None", "0.0")


def test_what_cannot_be_opened_is_said_in_one_sentence(stand: Stand) -> None:
    code = """if True:
        from physment_trl import PhysMent
        from physment_trl.in_process import InProcessPhysMent
        for env, row in ((PhysMent(), {{"scene": 9999}}), (InProcessPhysMent(), {{"split": "train", "random_seed": 1}}),
                         (InProcessPhysMent(), {{"split": "train@9", "index": 0}}), (InProcessPhysMent(), {{}})):
            try:
                env.reset(**row)
            except Exception as error:
                print(error)
        print(InProcessPhysMent().reset(split="train", index=0)[:3])
    """.replace("{{", "{").replace("}}", "}")
    first, second, third, fourth, opened = said(stand, code)
    assert "no scene 9999" in first
    assert "names scene and seed, or split and index" in second
    assert "train@9" in third
    assert fourth.endswith("{}")
    assert opened == "You"
    alone = said(
        stand,
        "from physment_trl import PhysMent\ntry:\n  PhysMent().reset(scene=7)\nexcept Exception as e:\n  print(e)",
        PHYSMENT_REFEREE_URL="http://127.0.0.1:9",
    )
    assert "start `physment-eval referee`" in alone[0]


def test_another_version_of_trl_is_refused_in_one_sentence(stand: Stand) -> None:
    code = "import importlib.metadata as m; m.version = lambda name: '1.17.0'; import physment_trl"
    assert stand.run("python", "-c", code).stderr.splitlines()[-1] == (
        "ImportError: physment-trl is tested with trl 1.16 and not with 1.17.0: pip install 'trl==1.16.*'"
    )
