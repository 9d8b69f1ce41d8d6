"""Tests of the comparison of two runs: pairs of episodes, the better run, and refusals."""

import json
import re
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.errors import UsageError
from evaluator.records.episode import EpisodeKey, Outcome
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.scores.comparison import Comparison, Side, compare
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.statistics.paired import PairedTest
from evaluator.store.run_folder import RunFolder
from tests.builders.records import VERSIONS, episode, episode_key, grade
from tests.builders.scored import scored

CATEGORIES = ("easy-single", "hard-multi", "create-delete-attach")


def side(
    name: str,
    right: Callable[[EpisodeKey], bool | None],
    *,
    scenes: Iterable[int] = range(7, 47),
    agents: Iterable[str] = ("x",),
    budgets: Iterable[int] = (20,),
    seeds: Iterable[int] = (0,),
    prompting: str = "zero-shot",
    packs: Callable[[int], str] = lambda _: "aa",
    grader: str = "1",
    key: float = 1.0,
) -> Side:
    rows: list[ScoredEpisode] = []
    for one in (
        episode_key(scene, seed=seed, agent=agent, budget=budget, prompting=prompting)
        for scene in scenes
        for seed in seeds
        for agent in agents
        for budget in budgets
    ):
        pack, verdict = packs(one.scene), grade(right(one))
        outcome = Outcome.INFRASTRUCTURE_ERROR if right(one) is None else Outcome.ANSWERED
        kind = "comparison" if one.scene % 2 else "calculation"
        played = episode(key=one, outcome=outcome, versions=VERSIONS.model_copy(update={"pack": pack}))
        rows.append(scored(played, verdict, CATEGORIES[one.scene % 3], kind, answer_key=key, grader_version=grader))
    return Side(name, rows)


def test_the_better_of_two_agents_is_named_with_the_certainty() -> None:
    found = compare(
        side("runs/one", lambda key: key.scene < 22, agents=["x"]),
        side("runs/two", lambda key: key.scene < 32, agents=["y"]),
    )
    # Of 40 scenes, x is right in 15 and y in 25. In all ten that differ, y is right: p = 2 / 2¹⁰.
    assert (found.a, found.b, found.better) == ("x", "y", "b")
    assert (found.strict.first_correct, found.strict.second_correct, found.strict.n) == (15, 25, 40)
    assert found.strict.p_value == pytest.approx(2 / 2**10)
    assert found.sentence.startswith(
        "y (B) is better than x (A) on 40 common episodes of 40 scenes: 62.5 % against 37.5 % right, B − A = +25.0"
        " points (95 % interval +"
    )
    assert found.sentence.endswith("; p = 0.002, exact McNemar test.")


def test_runs_that_differ_in_their_presentation_alone_are_named_by_it() -> None:
    plain, renamed = side("one", lambda _: False), side("two", lambda _: True)
    renamed = Side(renamed.name, renamed.rows, ("names", "units"))
    found = compare(plain, renamed)
    assert (found.a, found.b) == ("x (as presented)", "x (presentation names, units)")


def test_open_worlds_and_scenes_of_the_suite_are_not_compared_together() -> None:
    def run(name: str, categories: dict[int, str]) -> Side:
        played = {scene: episode(key=episode_key(scene, agent=name)) for scene in categories}
        return Side(name, [scored(played[scene], grade(right=True), where) for scene, where in categories.items()])

    both = {7: "easy-single", 201: "open", 202: "open"}
    with pytest.raises(UsageError, match="leave the open worlds out with --without 201,202, or the suite"):
        compare(run("a", both), run("b", both))
    assert compare(run("a", {201: "open", 202: "open"}), run("b", both)).strict.n == 2


def test_the_order_of_the_runs_does_not_change_who_is_better() -> None:
    one = side("one", lambda key: key.scene < 22, agents=["x"], seeds=range(3))
    two = side("two", lambda key: key.scene < 40 and key.seed < 2, agents=["y"], seeds=range(3))
    forth, back = compare(one, two), compare(two, one)
    # x is right in 15 scenes at three seeds, y in 33 scenes at two seeds: 45 and 66 of 120 episodes.
    assert (forth.better, back.better) == ("b", "a")
    assert forth.strict.p_value == back.strict.p_value
    assert forth.strict.difference == -back.strict.difference == pytest.approx(21 / 120)
    assert forth.strict.test is PairedTest.SIGN_FLIP
    told = "on 120 common episodes of 40 scenes: 55.0 % against 37.5 % right, B − A ="
    assert forth.sentence.startswith(f"y (B) is better than x (A) {told} +17.5 points (95 % interval +")
    assert back.sentence.startswith(f"y (A) is better than x (B) {told} −17.5 points (95 % interval −")


def test_a_run_compared_with_itself_is_labelled_first_and_second() -> None:
    found = compare(side("one", bool), side("one", bool))
    assert (found.a, found.b, found.better) == ("one (first)", "one (second)", None)
    lone = compare(side("one", bool, scenes=[8]), side("two", bool, scenes=[8]))
    assert "on 1 common episode of 1 scene: 100.0 % against 100.0 % right, B − A = +0.0 points; p = 1" in lone.sentence


def test_runs_without_a_significant_difference_are_not_ranked() -> None:
    found = compare(side("one", lambda key: key.scene < 30), side("two", lambda key: key.scene < 31))
    assert (found.better, found.a, found.b) == (None, "one", "two")
    assert found.sentence.startswith(
        "two (B) and one (A) cannot be told apart on 40 common episodes of 40 scenes: 60.0 % "
    )
    assert "p = 1, exact McNemar test" in found.sentence


def test_conditions_with_one_value_in_each_run_are_compared() -> None:
    found = compare(
        side("one", lambda key: key.scene < 20, budgets=[5]),
        side("two", lambda key: key.scene < 40, budgets=[20], prompting="few-shot"),
    )
    assert (found.a, found.b) == ("x (budget 5, zero-shot)", "x (budget 20, few-shot)")
    assert found.better == "b"
    assert {one.grouping for one in found.groups} == {
        *("problem kind", "problem type", "difficulty and breadth", "modality", "category")
    }


def test_conditions_with_several_values_are_equal_within_a_pair() -> None:
    found = compare(
        side("one", lambda key: key.scene < 20, agents=["x"], budgets=[5, 10, 20]),
        side("two", lambda key: key.scene < 20 or key.budget == 20, agents=["y"], budgets=[10, 20, 40]),
    )
    assert (found.strict.n, found.only_a, found.only_b) == (80, 40, 40)
    groups = {one.group: one for one in found.groups if one.grouping == "budget"}
    assert list(groups) == ["10", "20"]
    assert groups["10"].difference.difference == 0
    assert groups["20"].difference.difference == pytest.approx(27 / 40)
    assert groups["20"].p_adjusted == pytest.approx(2 * 2 / 2**27)
    assert groups["10"].p_adjusted == 1


def test_of_several_agents_the_common_one_is_compared_with_itself() -> None:
    one = side("one", lambda key: key.scene < 20, agents=["x", "y"])
    two = side("two", lambda key: key.scene < 20, agents=["x"])
    found = compare(one, two)
    assert (found.strict.n, found.only_a, found.strict.difference) == (40, 40, 0)


def test_unscored_episodes_are_left_out_and_counted() -> None:
    found = compare(
        side("one", lambda key: None if key.scene == 7 else True),
        side("two", lambda key: None if key.scene in {7, 8} else False),
    )
    assert (found.unscored, found.strict.n, found.strict.n_scenes) == (2, 38, 38)
    with pytest.raises(UsageError, match="an infrastructure error ended every episode"):
        compare(side("one", lambda _: None), side("two", lambda _: True))


def refusal(one: Side, two: Side) -> str:
    with pytest.raises(UsageError) as refused:
        compare(one, two)
    return str(refused.value)


def test_runs_without_a_common_episode_are_refused_with_the_property_they_do_not_share() -> None:
    one = side("one", bool, scenes=range(7, 30))
    assert refusal(one, side("two", bool, scenes=range(50, 60))) == (
        "one and two have no episode in common: scene 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21 … against"
        " 50, 51, 52, 53, 54, 55, 56, 57, 58, 59"
    )
    assert "seed 0 against 1, 2" in refusal(one, side("two", bool, seeds=[1, 2]))
    several = side("two", bool, agents=["y", "z"])
    assert refusal(one, several).endswith("agent x against y, z; choose one of each with --a agent=… --b agent=…")
    assert refusal(one, side("two", bool, scenes=[])) == "two holds no episodes, or none of those chosen"
    crossed = Side("two", [*side("", bool, scenes=[7], seeds=[1]).rows, *side("", bool, scenes=[99]).rows])
    assert "no scene, seed, epoch is the same in both" in refusal(side("one", bool, scenes=[7]), crossed)


def test_different_packs_of_a_scene_are_refused() -> None:
    one, two = side("one", bool), side("two", bool, packs=lambda scene: "bb" if scene in {8, 21} else "aa")
    assert refusal(one, two) == (
        "one and two were played on different packs of scenes 8, 21, which are not the same tasks;"
        " leave them out with --without 8,21"
    )
    every = refusal(one, side("two", bool, packs=lambda _: "bb"))
    assert "scenes 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18 and 28 more, which" in every


def test_different_graders_and_different_keys_are_refused() -> None:
    one = side("one", bool)
    assert "different versions of the grader (1, 2); run `physment-eval grade` on both" in refusal(
        one, side("two", bool, grader="2")
    )
    assert "graded against different keys of scenes 7, 8" in refusal(one, side("two", bool, key=2.0))


def test_an_unsealed_run_is_refused() -> None:
    assert refusal(side("one", bool), side("two", bool, agents=["external-unsealed:codex"])) == (
        "two: external-unsealed:codex could read the packs, so its results compare with nothing"
    )


# As a command.
def stored(folder: Path, made: Side, engine: str = "3.3.3") -> Path:
    run = RunFolder(folder)
    run.create(resume=False)
    plan, server = Plan(scenes=(7,), agents=("x",)), ServerRecord(option="host")
    run.write_run(
        RunRecord(created_at="2026-01-01T00:00:00+00:00", plan=plan, server=server, versions={"mujoco": engine})
    )
    for row in made.rows:
        run.append_episode(row.episode)
    run.write_grades(row.record for row in made.rows)
    return folder


@pytest.fixture
def runs(tmp_path: Path) -> tuple[str, str]:
    one = side("", lambda key: key.scene < 12, scenes=range(7, 23), agents=["x[/]"], budgets=[5, 20])
    two = side("", lambda key: key.scene < 21, scenes=range(7, 23), agents=["y"], budgets=[5, 20])
    return str(stored(tmp_path / "one", one)), str(stored(tmp_path / "two", two))


def test_the_command_prints_a_sentence_and_a_table(runs: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", *runs]) == 0
    said = capsys.readouterr().out
    assert said.startswith(
        "y (B) is better than x[/] (A) on 32 common episodes of 16 scenes: 87.5 % against 31.2 % right, B − A = +56.2"
    )
    lines = {line.split("  ")[0].strip(): line.split() for line in said.splitlines() if "/" in line}
    assert lines["strict"][1:7] == ["16", "10/32", "31.2", "%", "28/32", "87.5"]
    for group in ("budget", "category", "easy-single", "quantitative", "modality"):
        assert group in said


def test_in_a_terminal_of_80_columns_no_number_of_the_table_is_cut(
    runs: tuple[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, value in (("FORCE_COLOR", "1"), ("TERM", "dumb"), ("COLUMNS", "80")):
        monkeypatch.setenv(name, value)
    assert main(["compare", *runs]) == 0
    said = re.sub(r"\x1b\[[\d;]*m", "", capsys.readouterr().out)
    table = said[said.index(" A right") : said.index("differences in points")]
    assert max(map(len, table.splitlines())) <= 80
    assert "…" not in table
    (strict,) = (line for line in table.splitlines() if line.startswith(" strict"))
    assert strict.split()[:6] == ["strict", "31.2", "%", "87.5", "%", "+56.2"]


def test_the_sentence_and_the_table_say_the_same_difference_in_either_order(
    runs: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    for first, second, difference in ((*runs, "+56.2"), (*reversed(runs), "−56.2")):
        assert main(["compare", first, second]) == 0
        said = capsys.readouterr().out
        (strict,) = (line for line in said.splitlines() if line.startswith(" strict"))
        told = re.search(r"B − A = (\S+) points \(95 % interval (\S+) to (\S+)\)", said)
        assert told is not None
        assert told[1] == difference
        assert f"  {told[1]}  {told[2]} to {told[3]}  " in strict


def test_the_command_says_if_the_runs_had_different_engines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = side("", lambda key: key.scene < 12, scenes=range(7, 14), agents=["x"], budgets=[5])
    older, newer = (str(stored(tmp_path / engine, made, engine)) for engine in ("3.3.3", "4.0.0"))
    assert main(["compare", older, newer]) == 0
    assert "A was played with MuJoCo 3.3.3 and B with 4.0.0" in capsys.readouterr().out
    assert main(["compare", older, older]) == 0
    assert "MuJoCo" not in capsys.readouterr().out


def test_the_command_prints_all_numbers_as_json(runs: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", *runs, "--json", "--a", "budget=5", "--b", "budget=20"]) == 0
    found = Comparison.model_validate_json(capsys.readouterr().out)
    assert (found.a, found.b, found.better) == ("x[/] (budget 5)", "y (budget 20)", "b")
    assert (found.strict.n, found.strict.n_scenes) == (16, 16)
    # In all nine scenes that differ, y is right: p = 2 / 2⁹.
    assert found.strict.p_value == pytest.approx(2 / 2**9)


def test_two_parts_of_one_study_are_compared(runs: tuple[str, str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["compare", runs[0], runs[0], "--a", "budget=5", "--b", "budget=20"]) == 0
    assert "cannot be told apart on 16 common episodes of 16 scenes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--a", "budget"], "--a budget: write NAME=VALUE, NAME one of agent, budget, prompting, protocol"),
        (["--b", "scene=7"], "--b scene=7: write NAME=VALUE"),
        (["--b", "budget=7"], "two holds no episodes, or none of those chosen"),
        (["--without", "x"], "--without x: write whole numbers and ranges"),
        (["--without", "0-200"], "one holds no episodes, or none of those chosen"),
    ],
)
def test_a_wrong_choice_is_refused_in_a_sentence(
    runs: tuple[str, str], capsys: pytest.CaptureFixture[str], words: list[str], sentence: str
) -> None:
    assert main(["compare", *runs, *words]) == 2
    assert sentence in capsys.readouterr().err


def test_a_folder_without_run_or_grades_is_refused(
    tmp_path: Path, runs: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["compare", runs[0], str(tmp_path)]) == 2
    assert "is not a run folder" in capsys.readouterr().err
    (Path(runs[1]) / "grades.jsonl").unlink()
    assert main(["compare", *runs]) == 2
    assert "not every episode is graded; run `physment-eval grade" in capsys.readouterr().err


def test_leaving_out_the_scenes_with_different_packs_makes_runs_comparable(
    tmp_path: Path, runs: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    other = side("", bool, scenes=range(7, 23), agents=["z"], budgets=[5, 20], packs=lambda n: "b" if n < 9 else "aa")
    folder = str(stored(tmp_path / "other", other))
    assert main(["compare", runs[0], folder]) == 2
    assert "leave them out with --without 7,8" in capsys.readouterr().err
    assert main(["compare", runs[0], folder, "--without", "7,8", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["strict"]["n_scenes"] == 14
