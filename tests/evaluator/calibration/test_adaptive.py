"""Tests of adaptive testing: the choice of scenes by information, simulated takers, and recorded runs."""

import json
import math
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from evaluator.calibration.adaptive import EXPOSED, AdaptiveTest, read_difficulties
from evaluator.calibration.model import Spreads
from evaluator.records.calibration import Calibration, SceneStanding
from evaluator.records.episode import EpisodeKey
from evaluator.statistics.ability import (
    SceneDifficulty,
)
from evaluator.store.run_folder import RunFolder
from evaluator.study.selection import SUITE, parse_scenes
from scenes import find_pack, pack_hash
from tests.builders.commands import Done, physment_eval
from tests.builders.records import episode_key
from tests.harness.calibration.adaptive import covers, simulated

SCENES = (7, 8, 9, 10, 11, 12)


def chance(logits: float) -> float:
    return 1 / (1 + math.exp(-logits))


def keys_of(scenes: range, seeds: int = 1) -> list[EpisodeKey]:
    return [episode_key(scene, seed=seed) for seed in range(seeds) for scene in scenes]


def a_test(name: str = "a", target: float = 0.0) -> AdaptiveTest:
    difficulties = {scene: SceneDifficulty((scene - 20) / 5, 0.0, 0.0) for scene in range(41)}
    return AdaptiveTest(name, difficulties, target, keys_of(range(41), 2))


def test_choices_are_among_the_five_most_informative_scenes_and_say_why() -> None:
    test = a_test()
    ((key, reason),) = test.choose(1)
    assert abs(key.scene - 20) <= 2
    assert reason.rank in range(1, EXPOSED + 1)
    assert (reason.ability, reason.difficulty) == (pytest.approx(0, abs=1e-9), (key.scene - 20) / 5)
    assert reason.information == pytest.approx(chance(-reason.difficulty) * chance(reason.difficulty))
    assert key not in test.waiting
    for scene in range(10):
        test.add(episode_key(scene, seed=9), is_right=True)
        test.add(episode_key(40 - scene, seed=9), is_right=scene < 5)
    assert all(reason.difficulty > 1.0 for _, reason in test.choose(8))


def test_takers_of_the_same_ability_do_not_all_play_the_same_scene_and_a_repetition_does() -> None:
    first = Counter(a_test(f"taker {number}").choose(1)[0][0].scene for number in range(200))
    assert len(first) == EXPOSED
    assert max(first.values()) < 80
    assert a_test("b").choose(5) == a_test("b").choose(5)


def test_a_test_ends_at_its_standard_error_or_when_nothing_is_left() -> None:
    test, played = a_test(target=0.6), 0
    while chosen := test.choose(1):
        test.add(chosen[0][0], is_right=played % 2 == 0)
        played += 1
    assert test.ability().se <= 0.6
    assert 10 < played < 20
    test = a_test()
    assert len(test.choose(1000)) == 82
    assert test.choose(1) == []


@pytest.mark.extended
def test_half_as_many_episodes_find_nearly_the_ability_of_the_full_test_and_intervals_cover() -> None:
    """Runs a smaller simulation than `tests.harness.calibration.adaptive`, which gives the published figures."""
    found = simulated(60, 1, np.random.default_rng(5))
    away = [one.half.ability - one.full.ability for one in found]
    assert all((one.full.answers, one.half.answers) == (105, 52) for one in found)
    assert math.sqrt(np.mean(np.square(away))) < 0.3
    assert 0.88 < np.mean([covers(one.truth, one.half) for one in found]) <= 1


def difficulties(folder: Path, *, of_other_packs: bool = False) -> Path:
    """A calibration of six easy scenes."""
    standings = [
        SceneStanding(
            name=f"scene {scene}",
            scene=scene,
            pack="c1:0" if of_other_packs else pack_hash(find_pack(scene)),
            rung="easy",
            right=1,
            answers=2,
            logits=place / 2,
            se=0.3,
            infit=1,
            outfit=1,
            separation=None,
            is_doubtful=False,
        )
        for place, scene in enumerate(SCENES)
    ]
    spreads = Spreads(1.0, 0.5)
    found = Calibration(
        takers=(), scenes=tuple(standings), effects=(), spreads=spreads, information={}, components=None, pairs=()
    )
    (folder / "calibration.json").write_text(found.model_dump_json(), encoding="utf-8")
    return folder / "calibration.json"


def run(tmp_path: Path, *words: str | Path) -> Done:
    agents = ("--agent", "taker:none", "--agent", "blind", "--server", "host", "--workers", "1")
    table = difficulties(tmp_path)
    return physment_eval(
        "run",
        *agents,
        "--adaptive",
        "1.6",
        "--concurrency",
        "2",
        "--difficulties",
        table,
        "--out",
        tmp_path / "run",
        *words,
    )


def test_an_adaptive_run_records_what_it_played_and_why_and_can_be_stopped_resumed_graded_and_reported(
    tmp_path: Path,
) -> None:
    matrix = ("--scenes", "7-13", "--seeds", "0-1")
    stopped = run(tmp_path, *matrix, "--max-time", "0.000001")
    assert (stopped.returncode, "--max-time is reached" in stopped.stderr) == (1, True)
    assert "scenes 13" in stopped.stderr
    done = run(tmp_path, *matrix, "--resume")
    assert done.returncode == 0, done.stderr
    folder = RunFolder(tmp_path / "run")
    record, played = folder.read_run(), list(folder.episodes().values())
    assert record.plan.scenes == SCENES
    assert record.plan.adaptive is not None
    assert record.plan.adaptive.se == 1.6
    by_agent = Counter(episode.key.agent for episode in played)
    assert 2 <= by_agent["taker:none"] < 12
    for agent in record.plan.agents:
        reasons = [one.chosen for one in played if one.key.agent == agent and one.chosen is not None]
        assert len(reasons) == by_agent[agent]
        assert reasons[0].se > reasons[-1].se > 1.6
    summary = json.loads(folder.summary_file.read_text(encoding="utf-8"))
    found = {one["agent"]: one["estimate"] for one in summary["abilities"]}
    assert all(found[agent]["se"] <= 1.6 or by_agent[agent] == 12 for agent in record.plan.agents)
    assert found["taker:none"]["ability"] > found["blind"]["ability"]
    assert "episodes that an adaptive test chose" in done.stdout
    assert "Ability by adaptive test" in folder.report_file.read_text(encoding="utf-8")
    before = folder.episodes_file.read_bytes()
    assert run(tmp_path, *matrix, "--resume").returncode == 0
    assert folder.episodes_file.read_bytes() == before
    for command in (("grade", folder.path), ("report", folder.path, "--export", "md"), ("replay", folder.path)):
        again = physment_eval(*command)
        assert again.returncode == 0, again.stderr
    assert "Ability by adaptive test" in (folder.path / "tables.md").read_text(encoding="utf-8")
    other = run(tmp_path, *matrix, "--resume", "--adaptive", "0.5")
    assert (other.returncode, "other plan" in other.stderr) == (2, True)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--shard", "1/2"), "each scene depends on the answers before it, so a run has no shards"),
        (("--scenes", "20"), "no scene of this run is in"),
        (("--adaptive", "0"), "not a standard error above 0"),
        (("--difficulties", "absent.json"), "absent.json cannot be read as a calibration"),
    ],
)
def test_what_contradicts_an_adaptive_run_is_refused_in_one_sentence(
    tmp_path: Path, words: tuple[str, ...], sentence: str
) -> None:
    done = run(tmp_path, "--scenes", "7-9", *words)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert sentence in done.stderr


def test_held_back_seeds_and_difficulties_without_a_test_are_refused(tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_text("0123456789abcdef" * 4, encoding="utf-8")
    done = run(tmp_path, "--scenes", "7", "--seed-key", key)
    assert "would tell which answers on held-back seeds are right" in done.stderr
    done = physment_eval("run", "--scenes", "7", "--difficulties", difficulties(tmp_path))
    assert "--difficulties needs --adaptive SE" in done.stderr


def test_the_difficulties_that_ship_know_most_packs_of_the_suite() -> None:
    table = read_difficulties()
    known = [files.scene_id for files in parse_scenes(SUITE, None) if table.holds(files)]
    assert len(known) > 85
    assert all(0 < table.difficulties[scene].se < 2 for scene in known)


def test_a_pack_that_has_changed_since_the_calibration_has_no_known_difficulty(tmp_path: Path) -> None:
    assert not any(
        read_difficulties(difficulties(tmp_path, of_other_packs=True)).holds(find_pack(one)) for one in SCENES
    )
    assert all(read_difficulties(difficulties(tmp_path)).holds(find_pack(one)) for one in SCENES)
