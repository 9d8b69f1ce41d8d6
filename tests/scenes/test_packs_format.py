"""Tests of the pack format: sampled values, expressions, errors of malformed packs; and every pack of the suite."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from scenes import Pack, PackError, PackFiles, Permissions, draw_knobs, drawn_mjcf, find_pack, list_packs, read_pack
from scenes.draw import evaluate
from scenes.protocol import Call, answer, call, drawn_kind, load_solution
from tests.builders.paths import ORIGINAL

OWN = list_packs()
NOWHERE = PackFiles(7, Path("Scene7"))
GOOD: dict[str, Any] = {
    "metadata": {"scene_name": "a", "task": "t", "problem_type": "calculation"},
    "answer": 1,
    "objects": {"object_1": {"name": "ball", "object_id": "1"}},
    "knobs": {
        "u": {"canonical": 2, "uniform": [0, 10]},
        "l": {"canonical": 2, "log_uniform": [1, 100]},
        "c": {"canonical": "a", "choice": ["a", "b", "c"]},
        "p": {"canonical": [1, 2, 3, 4], "permutation": [1, 2, 3, 4]},
    },
    "derive": {"d": "u * l"},
    "accept_draw": ["u > 1"],
}


def pack(**changes: Any) -> Pack:
    return Pack.model_validate(GOOD | changes)


@pytest.fixture
def folder(tmp_path: Path) -> Callable[..., Path]:
    """Writes a pack; returns the folder of packs."""

    def write(text: str | None, xml: str | None = "<mujoco/>") -> Path:
        inner = tmp_path / "Scene7"
        inner.mkdir(exist_ok=True)
        if text is not None:
            (inner / "scene7.json").write_text(text, encoding="utf-8")
        if xml is not None:
            (inner / "scene7.xml").write_text(xml, encoding="utf-8")
        return tmp_path

    return write


# The draw


@pytest.mark.parametrize(
    ("seed", "drawn"),
    [
        (0, {"u": 2, "l": 2, "c": "a", "p": (1, 2, 3, 4), "d": 4}),
        (1, {"u": 5.52716, "l": 1.85195, "c": "c", "p": (3, 4, 2, 1), "d": 5.52716 * 1.85195}),
        (2, {"u": 6.58459, "l": 2.63474, "c": "a", "p": (4, 3, 2, 1), "d": 6.58459 * 2.63474}),
        (-5, {"u": 1.49169, "l": 1.56561, "c": "a", "p": (3, 1, 2, 4), "d": 1.49169 * 1.56561}),
        (10**30, {"u": 8.30266, "l": 4.14569, "c": "b", "p": (1, 4, 3, 2), "d": 8.30266 * 4.14569}),
    ],
)
def test_a_seed_always_draws_the_same_values(seed: int, drawn: dict[str, Any]) -> None:
    assert draw_knobs(NOWHERE, pack(), seed) == drawn


def test_a_knob_does_not_depend_on_which_other_knobs_there_are() -> None:
    alone = pack(knobs={"l": GOOD["knobs"]["l"]}, derive={}, accept_draw=[])
    assert draw_knobs(NOWHERE, alone, 1)["l"] == draw_knobs(NOWHERE, pack(), 1)["l"]


def test_twins_differ_in_the_reseeded_knobs_alone() -> None:
    first, second = draw_knobs(NOWHERE, pack(), 1), draw_knobs(NOWHERE, pack(), 1, reseed={"u": 2})
    assert {name for name in first if first[name] != second[name]} == {"u", "d"}
    assert second["u"] == draw_knobs(NOWHERE, pack(), 2)["u"]


def test_draws_stay_in_their_ranges_and_meet_the_conditions() -> None:
    choosy = pack(accept_draw=["u > 9"], knobs=GOOD["knobs"] | {"u": {"canonical": 9.5, "uniform": [0, 10]}})
    for seed in range(1, 100):
        drawn: dict[str, Any] = draw_knobs(NOWHERE, choosy, seed)
        assert 9 < drawn["u"] <= 10
        assert 1 <= drawn["l"] <= 100
        assert drawn["c"] in {"a", "b", "c"}
        assert sorted(drawn["p"]) == [1, 2, 3, 4]
        assert drawn["u"] == float(f"{drawn['u']:.6g}")


def test_conditions_that_nothing_meets_are_an_error_of_the_pack() -> None:
    with pytest.raises(PackError, match=r"scene7\.json: field accept_draw: the canonical values do not meet it"):
        draw_knobs(NOWHERE, pack(accept_draw=["u > 3"]), 0)
    with pytest.raises(PackError, match=r"scene7\.json: field accept_draw: no draw of seed 4 met it"):
        draw_knobs(NOWHERE, pack(accept_draw=["u > 11"]), 4)


# Expressions


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("2 * u", 3.0), ("p[1]", 7), ("abs(-u) + max(1, 2)", 3.5), ("sin(radians(30))", pytest.approx(0.5)),
        ("-u", -1.5), ("u > 1", True), ("'red' if u > 1 else 'blue'", "red"), ("pi", pytest.approx(3.14159265)), (4, 4),
        (0.5, 0.5), ("[1, 2][0]", 1), ("min(p)", 5),
    ],
)  # fmt: skip
def test_an_expression_is_arithmetic_over_the_knobs(expression: Any, value: Any) -> None:
    assert evaluate(NOWHERE, "derive.x", expression, {"u": 1.5, "p": (5, 7)}) == value


@pytest.mark.parametrize(
    "expression",
    [
        "__import__('os')", "u.__class__", "u.real", "'a'.upper()", "().__class__.__bases__", "open('x')", "eval('1')",
        "(lambda: 1)()", "print(u)", "nope", "u = 3", "u += 3", "import os", "", "((((", "9**9**9", "'a' * 10**9",
        "[0] * 10**9", "1/0", "sqrt(-1)", "1e308 * 10", "10**400", "10.0**400", "p[5]", "u[0]", "[1, 2]", "None",
        "sqrt", "1j", "1" + "+1" * 5000, "9" * 5000,
    ],
)  # fmt: skip
def test_an_expression_that_is_anything_else_is_refused_with_file_and_field(expression: str) -> None:
    with pytest.raises(PackError) as error:
        evaluate(NOWHERE, "derive.x", expression, {"u": 1.5, "p": (5, 7)})
    assert str(error.value).startswith("Scene7/scene7.json: field derive.x: ")
    assert len(str(error.value)) < 400


_BOUNDED = """
import json, resource, sys
from pathlib import Path
from scenes import PackError, PackFiles
from scenes.draw import evaluate
from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.contract.formulas import Formulas

resource.setrlimit(resource.RLIMIT_CPU, (20, 20))
used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 2**26, used + 2**26))
for text in json.load(sys.stdin):
    try:
        evaluate(PackFiles(7, Path("Scene7")), "derive.x", text, {"u": 1.5, "p": (5, 7), "s": "ab"})
    except PackError as error:
        assert "MemoryError" not in repr(error.__cause__), text
    else:
        print("evaluated as a quantity:", text[:40])
    try:
        Formulas(["x"], {}, {}, {"f": text}).function(["x"])(1.0)
    except (ExpressionError, ArithmeticError, ValueError):
        pass
"""


@pytest.mark.skipif(not Path("/proc/self/statm").is_file(), reason="reads its memory as Linux tells it")
def test_no_expression_takes_much_memory_or_time() -> None:
    """Evaluates hostile expressions in a process that is limited to 20 s and 64 MB."""
    hostile = [
        "'%1000000000d' % 1", "'%s' % ('a' * 10**9)", "'%*d' % (10**9, 1)", "'a' * 10**9", "s * 10**9", "10**9 * p",
        "[0] * 10**9", "[[0] * 10**5] * 10**5", "10**10**10", "9**9**9**9", "4000000**4000000", "(2**1000)**1000000",
        "-2**(10**8)", "(-3)**99999999", "2**2**2**2**2**2", "2**1000 * 2**1000", "'{:1000000000d}'.format(1)",
        "f'{1:1000000000d}'", "f'{u:>{10**9}}'", "[x for x in p for y in p for z in p]", "{x: 1 for x in p}",
        "sum(x for x in p)", "list(s) * 10**9", "max([0] * 10**9)", "1 << 10**10", "~0", "1 | 2", "'a' + 'b' * 10**9",
        "p + p", "s + s", "(((" * 300, "-" * 999 + "u * None", "[" * 80 + "]" * 80, "1 +" * 100_000 + "'a'", "*p,",
        "'" + "a" * 10**6 + "'", "9" * 900 + " ** 9", "p[0:10**9]", "min(*p)", "max(p, key=abs)", "(u := 3)",
        "(" + "u<(" * 29 + "u" + ")<u" * 29 + ") + s", "x<(" * 29 + "x" + ")<x" * 29,
    ]  # fmt: skip
    words = [sys.executable, "-c", _BOUNDED]
    done = subprocess.run(words, input=json.dumps(hostile), capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


# Errors of bad packs


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"metadata": {"scene_name": "a", "problem_type": "b"}}, "metadata.task"),
        ({"metadata": {**GOOD["metadata"], "task": ""}}, "metadata.task"),
        ({"answer": None}, "answer"),
        ({"answer": {"value": 1}}, "answer"),
        ({"objects": []}, "objects"),
        ({"objects": {"object_1": {"name": "x"}}}, "objects.object_1.object_id"),
        (
            {"object_permissions": {"object_1_permissions": {"body_pos": 7}}},
            "object_permissions.object_1_permissions.body_pos",
        ),
        ({"category": "medium"}, "category"),
        ({"answer_spec": {"kind": "guess"}}, "answer_spec.kind"),
        ({"answer_spec": {"kind": "number", "rel_tol": -1}}, "answer_spec.rel_tol"),
        ({"knobs": {"m": {"canonical": 1}}}, "knobs.m"),
        ({"knobs": {"m": {"canonical": 1, "uniform": [0, 1], "choice": [1]}}}, "knobs.m"),
        ({"knobs": {"m": {"canonical": 1, "uniform": [1, 1]}}}, "knobs.m"),
        ({"knobs": {"m": {"canonical": 1, "log_uniform": [0, 1]}}}, "knobs.m"),
        ({"knobs": {"m": {"uniform": [0, 1]}}}, "knobs.m.canonical"),
        ({"format": 2}, "format"),
        ({"number_of_objects": "many"}, "number_of_objects"),
    ],
)
def test_a_malformed_pack_is_refused_with_file_and_field_in_one_sentence(
    folder: Callable[..., Path], changes: dict[str, Any], field: str
) -> None:
    files = find_pack(7, folder(json.dumps(GOOD | changes)))
    with pytest.raises(PackError) as error:
        read_pack(files)
    assert str(error.value).startswith(f"{files.json}: field {field}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "word"), [("{", "not JSON"), ("", "not JSON"), ("[]", "the whole file"), (None, "no such")]
)
def test_a_file_that_is_not_a_pack_is_named(folder: Callable[..., Path], text: str | None, word: str) -> None:
    files = find_pack(7, folder(text))
    with pytest.raises(PackError, match=word) as error:
        read_pack(files)
    assert str(files.json) in str(error.value)


def test_a_file_that_is_not_utf8_is_named(folder: Callable[..., Path]) -> None:
    files = find_pack(7, folder("{}"))
    for file in (files.json, files.mjcf):
        file.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(PackError, match="UTF-8"):
        read_pack(files)
    with pytest.raises(PackError, match="UTF-8"):
        drawn_mjcf(files, pack(), {}, canonical=True)


def test_a_missing_pack_is_refused_with_the_ids_of_all_packs(folder: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(PackError, match="no scene 8; the scenes here are 7"):
        find_pack(8, folder("{}"))
    with pytest.raises(PackError, match="no such folder"):
        list_packs(tmp_path / "nowhere")
    with pytest.raises(PackError, match="holds no scene packs"):
        list_packs(tmp_path / "Scene7")


@pytest.mark.parametrize(
    ("target", "xml", "word"),
    [
        ("geom", "<mujoco/>", "write targets as tag"),
        ("geom[g].mass", "<mujoco/>", "names 0 elements of the model"),
        ("geom.mass", "<mujoco><a><geom/><geom/></a></mujoco>", "names 2 elements of the model"),
        ("geom[g].mass", "<mujoco>", "not XML"),
        ("geom[g].mass", None, "no such file"),
    ],
)
def test_a_target_names_exactly_one_element(
    folder: Callable[..., Path], target: str, xml: str | None, word: str
) -> None:
    files = find_pack(7, folder("{}", xml))
    with pytest.raises(PackError, match=word):
        drawn_mjcf(files, pack(apply={target: "u"}), {"u": 1.0}, canonical=False)


def test_values_are_written_in_as_numbers_and_vectors(folder: Callable[..., Path]) -> None:
    files = find_pack(7, folder("{}", '<mujoco><geom name="a b"/><geom name="g" mass="9"/><option/></mujoco>'))
    written = pack(apply={"geom[g].mass": "u * 2", "option.gravity": [0, 0, "-u"], "geom[a b].rgba": "c"})
    text = drawn_mjcf(files, written, {"u": 0.1, "c": "1 0 0 1"}, canonical=False)
    assert text == (
        '<mujoco><geom name="a b" rgba="1 0 0 1" /><geom name="g" mass="0.2" /><option gravity="0 0 -0.1" /></mujoco>'
    )


def test_unknown_keys_of_other_peoples_packs_are_ignored(folder: Callable[..., Path]) -> None:
    read = read_pack(find_pack(7, folder(json.dumps(GOOD | {"mood": "good", "number_of_objects": "1"}))))
    assert read.number_of_objects == 1
    assert read.permissions_of("object_1").body_pos is False


# Reference protocols


def test_a_solution_gives_its_three_functions(folder: Callable[..., Path]) -> None:
    files = find_pack(7, folder("{}"))
    with pytest.raises(PackError, match=r"solution\.py: no such file"):
        load_solution(files)
    files.solution.write_text("def theory(knobs):\n    return knobs['g'] * 2\n", encoding="utf-8")
    solution = load_solution(files)
    assert solution.theory is not None
    assert solution.theory({"g": 4.5}) == 9
    assert solution.solve is None
    assert solution.measure is None
    files.solution.write_text("import no_such_module\n", encoding="utf-8")
    with pytest.raises(PackError, match="no_such_module"):
        load_solution(files)


def test_structure_and_theory_follow_from_the_law_of_a_structure(folder: Callable[..., Path]) -> None:
    files = find_pack(7, folder("{}"))
    files.solution.write_text("def predict(structure, knobs):\n    return structure + knobs['g']\n", encoding="utf-8")
    solution, drawn = load_solution(files), {"kind": "a", "g": "b", "sort": "c"}
    assert solution.structure is drawn_kind
    assert drawn_kind(drawn) == "a"
    assert solution.theory is not None
    assert solution.theory(drawn) == "ab"
    with files.solution.open("a", encoding="utf-8") as file:
        file.write("def structure(knobs):\n    return knobs['sort']\n")
    solution = load_solution(files)
    assert solution.structure is not None
    assert solution.theory is not None
    assert (solution.structure(drawn), solution.theory(drawn)) == ("c", "cb")
    with files.solution.open("a", encoding="utf-8") as file:
        file.write("def theory(knobs):\n    return 'd'\n")
    theory = load_solution(files).theory
    assert theory is not None
    assert theory(drawn) == "d"


def test_a_solution_that_fits_a_structure_and_names_none_takes_the_drawn_kind(folder: Callable[..., Path]) -> None:
    files = find_pack(7, folder("{}"))
    files.solution.write_text("def fit(readings, structure):\n    return 1.0\n", encoding="utf-8")
    solution = load_solution(files)
    assert solution.structure is drawn_kind
    assert solution.theory is None
    files.solution.write_text("def solve(task):\n    yield []\n", encoding="utf-8")
    assert load_solution(files).structure is None


def test_calls_of_a_protocol_are_plain_records() -> None:
    assert call("step", duration=0.1) == Call("step", {"duration": 0.1})
    assert answer([1.5, "a"]) == Call("answer", {"answer": [1.5, "a"]})


# All packs


@pytest.mark.published
def test_all_published_packs_load_and_run_for_a_second() -> None:
    published = ORIGINAL / "Scenes"
    packs = list_packs(published)
    assert len(packs) == 105
    for files in packs:
        session = Session(load_scene(files.scene_id, 0, published))
        session.world.step(session.world.whole_steps(1.0))
        assert session.world.time == pytest.approx(1, abs=session.world.timestep)
        assert session.known()


@pytest.mark.parametrize("files", OWN, ids=lambda files: str(files.scene_id))
def test_seed_0_is_the_scene_as_written(files: PackFiles) -> None:
    pack, text = read_pack(files), files.mjcf.read_text(encoding="utf-8")
    mjcf = load_scene(files.scene_id).mjcf
    assert mjcf == drawn_mjcf(files, pack, draw_knobs(files, pack, 0), canonical=True)
    if not pack.laws and "present=" not in text:
        assert mjcf == text


@pytest.mark.parametrize("files", OWN, ids=lambda files: str(files.scene_id))
def test_canonical_values_written_in_give_the_scene_as_written(files: PackFiles) -> None:
    read = read_pack(files)
    values = draw_knobs(files, read, 0)
    models = [
        mujoco.MjModel.from_xml_string(drawn_mjcf(files, read, values, canonical=canonical))
        for canonical in (True, False)
    ]
    for name in dir(models[0]):
        written, drawn = (getattr(model, name) for model in models)
        if isinstance(written, np.ndarray) and written.dtype.kind in "fiub":
            # In the XML, derived values may have fewer digits than the computed ones.
            np.testing.assert_allclose(written, drawn, rtol=1e-6, atol=1e-9, err_msg=name)
    for name in ("timestep", "gravity", "density", "viscosity", "wind", "integrator"):
        np.testing.assert_allclose(getattr(models[0].opt, name), getattr(models[1].opt, name), rtol=1e-6, err_msg=name)


@pytest.mark.parametrize("files", OWN, ids=lambda files: str(files.scene_id))
def test_variants_of_own_scenes_open(files: PackFiles) -> None:
    for seed in (1, 2):
        session = Session(load_scene(files.scene_id, seed))
        session.world.step(1)


def test_readable_attributes_are_named_in_words_and_depend_on_what_is_stated() -> None:
    assert Permissions().readable == ("velocity",)
    assert Permissions(body_pos=True, angle=True, velocity=False, spin=True).readable == ("position", "angle", "spin")
    assert Permissions(spin=False).readable == ("velocity",)
