"""Tests of the pages about scenes: their content, and what pages and images must not reveal."""

import io
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluator.calibration.adaptive import stated_difficulties
from evaluator.certify.difficulty import play
from evaluator.commands.program import main
from evaluator.pages.scene_table import KINDS, Listing, Steps, answer_form, scenes_page
from evaluator.pages.write import EXAMPLES, SEED, Example, examples_page, scene_pages
from evaluator.report.export import escaped
from physment_mcp.world.pictures.framing import FramedParts, view_of
from scenes import (
    AnswerKind,
    AnswerSpec,
    Category,
    Pack,
    PackFiles,
    default_folder,
    find_pack,
    list_packs,
    read_pack,
)
from tests.builders.author import Author
from tests.builders.paths import DOCS

PLANTED = "planted-canary"


def readable() -> list[tuple[PackFiles, Pack]]:
    return [(files, read_pack(files)) for files in list_packs()]


def copied(target: Path, *scenes: int) -> Path:
    for scene in scenes:
        shutil.copytree(default_folder() / f"Scene{scene}", target / f"Scene{scene}")
    return target


def edited(folder: Path, scene: int, **fields: object) -> None:
    path = folder / f"Scene{scene}" / f"scene{scene}.json"
    path.write_text(json.dumps({**json.loads(path.read_text("utf-8")), **fields}), "utf-8")


def written(folder: Path, out: Path, *options: str) -> tuple[int, str, str]:
    """Write the pages; returns the exit code and both pages."""
    code = main(["scenes", "pages", "--scenes-dir", str(folder), "--out", str(out), *options])
    pages = (out / "reference" / "scenes.md", out / "explanation" / "worked-examples.md")
    return code, pages[0].read_text("utf-8"), pages[1].read_text("utf-8")


@pytest.fixture
def three(tmp_path: Path) -> Path:
    return copied(tmp_path / "packs", 7, 8, 21)


def test_a_row_shows_what_an_agent_may_know(three: Path, tmp_path: Path) -> None:
    code, page, _ = written(three, tmp_path / "out", "--no-pictures")
    assert code == 0
    assert re.search(r"\| no picture drawn \|.* \| free fall \| a number \(m/s\); within 5 % \| 2, 1 \| 1 \|", page)
    assert r" rolling inertia | one of 3: object\_1, object\_2, 0 | 2, 1 | 2 |" in page
    assert page.index("## easy-single\n") < page.index("## easy-single-hidden\n")


def test_the_length_of_a_protocol_is_a_range_over_several_seeds(tmp_path: Path) -> None:
    author = Author(tmp_path)
    files = author.write(Category.EASY_SINGLE)
    longer = 'if readings[-1]["velocity"][0] > 2:\n        yield [call("step", duration=0.1)]\n    yield [answer('
    author.replace(files.solution, "yield [answer(", longer)
    _, page, _ = written(files.folder.parent, tmp_path / "out", "--no-pictures")
    lengths = {(len(run.turns), run.interventions) for run in (play(files, seed) for seed in range(5))}
    assert lengths == {(2, 2), (3, 3)}
    assert "| 2–3, 2–3 | 1 |" in page


def test_the_same_packs_give_identical_pages(three: Path, tmp_path: Path) -> None:
    assert written(three, tmp_path / "one", "--no-pictures") == written(three, tmp_path / "two", "--no-pictures")


def test_hidden_objects_are_not_counted(three: Path, tmp_path: Path) -> None:
    _, page, _ = written(three, tmp_path / "out", "--no-pictures")
    assert re.search(r"Something is in the chamber\]\(scenes/scene21\.md\) .*\| 1 \|\n", page)


def test_no_private_field_gets_into_a_page(three: Path, tmp_path: Path) -> None:
    edited(
        three,
        21,
        answer=2.7182818,
        expected_behavior=f"{PLANTED} how",
        reasoning=f"{PLANTED} why",
        objects={
            "object_1": {"name": "post", "object_id": "1"},
            "object_2": {"name": f"{PLANTED} thing", "object_id": "2"},
        },
        disabled_tools={"create_objects": PLANTED},
        knobs={"planted_knob": {"canonical": 3.14159, "log_uniform": [0.31234, 8.76543], "meaning": PLANTED}},
        derive={"planted_derived": "planted_knob"},
        apply={"geom[object_2_geom].mass": "planted_derived"},
    )
    _, page, examples = written(three, tmp_path / "out", "--no-pictures")
    private = ("planted_knob", "planted_derived", "2.7182818", "2.7183", "3.1416", "3.14159", "0.31234", "8.76543")
    own = (tmp_path / "out" / "reference" / "scenes" / "scene21.md").read_text("utf-8")
    assert [text for text in (PLANTED, *private) if text in page + own] == []
    assert "`create_objects`" in own
    assert [text for text in private if text in examples] == []
    # Examples show the method and the hidden object that the protocol finds.
    assert examples.count(PLANTED) == len(("how", "why", "thing"))


def test_no_row_depends_on_a_private_field() -> None:
    steps = Steps((3, 3), (2, 4))
    for files, pack in readable():
        visible = {key: listed for key, listed in pack.objects.items() if not pack.permissions_of(key).hidden}
        public = pack.model_copy(
            update={
                "answer": "x",
                "objects": visible,
                "metadata": pack.metadata.model_copy(update={"description": ""}),
                **dict.fromkeys(("expected_behavior", "reasoning"), ""),
                **{key: {} for key in ("knobs", "derive", "apply", "disabled_tools")},
                **dict.fromkeys(("accept_draw", "requires", "soft_objects"), ()),
            }
        )
        assert Listing.of(files, public, steps) == Listing.of(files, pack, steps), files.scene_id


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ({"kind": "number", "unit": "m/s", "abs_tol": 0.02}, "a number (m/s); within 5 % plus 0.02 m/s"),
        ({"kind": "number", "unit": "1", "rel_tol": 0.01}, "a number (no unit); within 1 %"),
        ({"kind": "number", "rel_tol": 0}, "a number; within rounding"),
        (
            {"kind": "numbers", "unit": "N", "labels": ["at x = 1.50 m", "at x = -1.50 m"]},
            "2 numbers: at x = 1.50 m (N), at x = -1.50 m (N); within 5 %",
        ),
        (
            {"kind": "numbers", "unit": ["m", "1"], "labels": ["way", "count"], "abs_tol": 0.02},
            "2 numbers: way (m), count (no unit); within 5 % plus 0.02",
        ),
        ({"kind": "numbers", "labels": ["way", "count"]}, "2 numbers: way, count; within 5 %"),
        ({"kind": "numbers", "unit": ["m", "s"]}, "2 numbers (m, s); within 5 %"),
        ({"kind": "numbers", "unit": "m and s"}, "several numbers (m and s); within 5 %"),
        ({"kind": "numbers"}, "several numbers; within 5 %"),
        ({"kind": "choice", "options": ["heavier", "lighter"]}, "one of 2: heavier, lighter"),
        ({"kind": "text"}, "a sentence"),
        (
            {
                "kind": "formula",
                "unit": "N",
                "variables": {"x": {"meaning": "way", "unit": "m", "range": [0, 1]}},
            },
            "a formula in x (N); within 5 %",
        ),
    ],
)
def test_the_form_of_an_answer_is_told_as_far_as_it_is_public(spec: dict[str, Any], words: str) -> None:
    assert answer_form(AnswerSpec.model_validate(spec)) == words
    assert answer_form(None) == ""


def test_each_list_of_numbers_is_told_as_long_as_its_answer_is() -> None:
    """The page states how many numbers an answer has only if the answer spec of the pack does."""
    for files, pack in readable():
        spec = pack.answer_spec
        if spec is None or spec.kind is not AnswerKind.NUMBERS:
            continue
        assert isinstance(pack.answer, tuple)
        counted = spec.labels or isinstance(spec.unit, tuple)
        expected = f"{len(pack.answer)} numbers" if counted else "several numbers"
        assert answer_form(spec).startswith(expected), files.scene_id


def test_the_list_contains_no_private_sentence_of_any_pack() -> None:
    packs = readable()
    page = scenes_page([Listing.of(files, pack, Steps((3, 3), (2, 4))) for files, pack in packs], ())
    for files, pack in packs:
        row = next(line for line in page.splitlines() if f'id="scene-{files.scene_id}"' in line)
        meanings = [knob.meaning for knob in pack.knobs.values()]
        private = [pack.reasoning, pack.expected_behavior, *meanings, *pack.disabled_tools.values()]
        assert not [text for text in private if text and text.lower() in row.lower()], files.scene_id
        assert not [text for text in hidden_numbers(pack) if text in row], files.scene_id


def hidden_numbers(pack: Pack) -> list[str]:
    """Return hidden numbers with at least 4 significant digits, as written; shorter ones match by chance."""
    answer = pack.answer if isinstance(pack.answer, tuple) else (pack.answer,)
    knobs = [
        value for knob in pack.knobs.values() for value in (knob.canonical, *(knob.uniform or knob.log_uniform or ()))
    ]
    values = [value for value in (*answer, *knobs) if isinstance(value, float)]
    texts = {text for value in values for text in (repr(value), f"{value:.5g}")}
    return [text for text in texts if len(re.sub(r"\D|^0\.0*", "", text.rstrip("0"))) >= 4]


def test_the_stored_page_of_each_scene_is_what_its_pack_and_certificate_say() -> None:
    packs = dict(readable())
    listings = [Listing.of(files, pack, None) for files, pack in packs.items()]
    folder = DOCS / "reference" / "scenes"
    pictured = {listing.scene for listing in listings if (folder / f"scene{listing.scene}.png").is_file()}
    difficulties = {scene: one.sentence for scene, one in stated_difficulties(packs).items()}
    made = dict(scene_pages(packs, listings, pictured, difficulties))
    assert set(made) == {file.name for file in folder.glob("*.md")}
    stored = {name: (folder / name).read_text("utf-8").splitlines(keepends=True) for name in made}
    measured = "- Length: the reference protocol takes "
    assert [name for name, lines in stored.items() if sum(line.startswith(measured) for line in lines) != 1] == []
    without = {name: "".join(line for line in lines if not line.startswith(measured)) for name, lines in stored.items()}
    assert [name for name in made if without[name] != made[name]] == []


def test_the_page_of_a_scene_has_its_task_limits_and_what_may_be_read_and_nothing_private() -> None:
    text = (DOCS / "reference" / "scenes" / "scene21.md").read_text("utf-8")
    assert text.startswith("# 21 ")
    assert "object\\_2" not in text, "it is hidden"
    for files, pack in readable():
        text = (DOCS / "reference" / "scenes" / f"scene{files.scene_id}.md").read_text("utf-8")
        rest = text.replace(escaped(pack.metadata.task), "")
        assert len(rest) < len(text)
        meanings = [knob.meaning for knob in pack.knobs.values()]
        private = [pack.reasoning, pack.expected_behavior, *meanings, *pack.disabled_tools.values()]
        assert not [one for one in private if one and one.lower() in rest.lower()], files.scene_id
        assert not [one for one in hidden_numbers(pack) if one in rest], files.scene_id


def test_there_is_one_example_of_each_category() -> None:
    categories = [category for category in Category if category is not Category.OPEN]
    assert [read_pack(find_pack(scene)).category for scene in EXAMPLES] == categories


def test_the_examples_show_neither_canonical_values_nor_ranges() -> None:
    for scene in EXAMPLES:
        files = find_pack(scene)
        pack = read_pack(files)
        transcript = play(files, SEED)
        page = examples_page([Example(scene, pack, transcript, "")])
        numbers = set(re.findall(r"\d+(?:\.\d+)?", page.replace(pack.metadata.task, "")))
        assert numbers.isdisjoint(hidden_numbers(pack)), scene
        changed = pack.model_copy(update={"answer": "x", "knobs": {}, "derive": {}, "apply": {}, "accept_draw": ()})
        assert examples_page([Example(scene, changed, transcript, "")]) == page


def test_an_example_has_the_task_the_method_and_the_run(three: Path, tmp_path: Path) -> None:
    _, _, page = written(three, tmp_path / "out", "--no-pictures")
    assert "## easy-single: Speed of a dropped ball (scene 7)" in page
    assert "scene 8" not in page
    assert "v = g t, with the gravity of this laboratory." in page
    assert "step(duration=0.8)  →  t = 0.8" in page
    assert "advantage" in page.split("##", 1)[0]
    assert "answer(answer=7.848)" not in page


def test_a_long_run_says_how_many_calls_are_left_out() -> None:
    files = find_pack(96)
    transcript = play(files, SEED)
    page = examples_page([Example(96, read_pack(files), transcript, "")])
    counts = re.findall(r"left out: (\d+) call|and (\d+) more call", page)
    left_out = [int(count) for groups in counts for count in groups if count]
    calls = sum(len(turn.calls) for turn in transcript.turns)
    assert f"and {calls} calls. {sum(left_out)} of the calls are left out" in page
    assert page.count("→") + page.count("answer(") == calls - sum(left_out)


def test_the_kinds_of_utopia_name_existing_scenes() -> None:
    existing = {files.scene_id for files in list_packs()}
    assert len(KINDS) == 6
    assert all(1 <= len(scenes) <= 4 and existing.issuperset(scenes) for scenes in KINDS.values())


def test_a_broken_pack_is_left_out_and_reported(
    three: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edited(three, 8, metadata={})
    (three / "Scene21" / "solution.py").write_text("def solve(task):\n    yield 1 / 0\n\ntheory = solve\n", "utf-8")
    code, page, _ = written(three, tmp_path / "out", "--no-pictures")
    said = capsys.readouterr().out
    assert code == 1
    assert "scene 8 is left out" in said
    assert "scene 21 is listed without its run" in said
    assert "Two balls" not in page
    assert (
        "Something is in the chamber](scenes/scene21.md) | Newton's second law | a number (kg); within 5 % | – | 1 |"
        in page
    )


def test_without_a_renderer_the_page_is_written_and_one_sentence_says_why_it_has_no_pictures(
    three: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "evaluator", "scenes", "pages", "--scenes-dir", str(three), "--out", "out"]
    done = subprocess.run(
        command,
        cwd=tmp_path,
        env={**os.environ, "MUJOCO_GL": "off"},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert [line for line in done.stdout.splitlines() if "nothing draws off-screen" in line and "libosmesa6" in line]
    assert (tmp_path / "out/reference/scenes.md").read_text("utf-8").count("no picture drawn") == 3
    assert not list(tmp_path.rglob("*.png"))


DRAW = """
import json, sys
from pathlib import Path
import numpy as np
from evaluator.certify.pictures import check_renderer, draw_picture
from scenes import find_pack
try:
    check_renderer()
except Exception as error:
    sys.exit(print("no renderer:", error))
for folder, scene, seed in json.loads(sys.argv[1]):
    np.save(sys.stdout.buffer, draw_picture(find_pack(scene, Path(folder)), seed))
"""


def drawn(*wanted: tuple[Path, int, int]) -> list[np.ndarray]:
    """Draw pictures of (folder, scene, seed) in a separate process."""
    environment = {**os.environ, "MUJOCO_GL": os.environ.get("MUJOCO_GL", "osmesa")}
    command = [sys.executable, "-c", DRAW, json.dumps([(str(folder), scene, seed) for folder, scene, seed in wanted])]
    done = subprocess.run(command, env=environment, capture_output=True, check=False, timeout=300)
    if done.returncode or done.stdout.startswith(b"no renderer"):
        pytest.skip(f"nothing draws off-screen here (MUJOCO_GL={environment['MUJOCO_GL']}); install libosmesa6")
    stream = io.BytesIO(done.stdout)
    return [np.load(stream) for _ in wanted]


def test_a_picture_of_exact_instruments_is_the_same_for_every_seed() -> None:
    scenes = (7, 17)
    pictures = drawn(*((default_folder(), scene, seed) for scene in scenes for seed in (0, 1)))
    for place, scene in enumerate(scenes):
        first, other = pictures[2 * place : 2 * place + 2]
        assert first.shape == (640, 960, 3), scene
        assert np.mean(np.any(first != first[0, 0], axis=2)) > 0.002, scene
        assert np.array_equal(first, other), scene


def test_a_hidden_body_leaves_no_trace_in_the_picture(tmp_path: Path) -> None:
    folder = copied(tmp_path / "packs", 21)
    path = folder / "Scene21" / "scene21.xml"
    text = path.read_text("utf-8")
    changed = text.replace('rgba="0.2 0.4 0.8 0"', 'rgba="0.2 0.4 0.8 1"').replace(
        'pos="1.5 0.4 1"', 'pos="0.3 -0.4 1"'
    )
    assert changed != text
    path.write_text(changed, "utf-8")
    plain, planted = drawn((default_folder(), 21, 0), (folder, 21, 0))
    assert np.array_equal(plain, planted)


def test_a_scene_whose_parts_all_depend_on_the_seed_gets_a_schematic_of_what_may_be_read(tmp_path: Path) -> None:
    sealed, private = copied(tmp_path / "sealed", 17), copied(tmp_path / "private", 17)
    may = json.loads((sealed / "Scene17" / "scene17.json").read_text("utf-8"))["object_permissions"]
    may["object_1_permissions"]["body_pos"] = not may["object_1_permissions"].get("body_pos", False)
    edited(sealed, 17, object_permissions=may)
    edited(private, 17, answer=2.7, reasoning=PLANTED, expected_behavior=PLANTED)
    plain, changed, same = drawn((default_folder(), 17, 0), (sealed, 17, 0), (private, 17, 0))
    assert plain.shape == (640, 960, 3)
    assert np.any(plain != changed)
    assert np.array_equal(plain, same)


def test_the_camera_keeps_all_objects_in_the_picture() -> None:
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    near, far = (
        view_of(FramedParts(cube, [], 1), 4 / 3),
        view_of(FramedParts(np.vstack([cube, cube + 9]), [], 1), 4 / 3),
    )
    assert near.distance > 1
    assert far.distance > 3 * near.distance
    assert np.linalg.norm(near.centre - 0.5) < 0.2


def test_the_pictures_of_the_stored_page_exist_and_are_small() -> None:
    page = (DOCS / "reference" / "scenes.md").read_text("utf-8")
    sources = re.findall(r'<img src="([^"]+)"', page)
    assert sources
    assert [source for source in sources if not (DOCS / "reference" / source).is_file()] == []
    assert sum(path.stat().st_size for path in (DOCS / "reference" / "scenes").rglob("*.png")) < 6_000_000
