"""Tests of the statement of a model's laws: its content, the laws that it omits, and models that have no statement."""

import importlib.util
import json
from types import ModuleType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physment_mcp.contract.expressions import Language, Node
from physment_mcp.contract.stated_laws import StatedLaw
from scenes import draw_knobs, drawn_mjcf, find_pack, read_pack
from scenes.law_statements import UnstatableLawError, folded, law_model, statement_of, written
from scenes.protocol import Protocol, answer, call
from scenes.reference_laws import inferred_law, law_with, stating

OPEN = range(201, 221)
LANGUAGE = Language()
NAMES = ("a", "b")


def model(laws: list[dict[str, Any]], bodies: str = "", options: str = 'gravity="0 0 0"') -> str:
    """A model with an object of 2 kg on a plane, and a hidden body of 4 kg that starts at x = 0.5."""
    slides = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
    data = json.dumps(laws).replace('"', "&quot;").replace("<", "&lt;")
    return (
        f'<mujoco><option {options}/><custom><text name="laws" data="{data}"/></custom><worldbody>'
        '<geom name="floor" type="cylinder" size="3 0.01" contype="0" conaffinity="0"/>'
        f'<body name="object_1" pos="0 0 0.05">{slides}<geom mass="2" contype="0" conaffinity="0"/></body>'
        f'<body name="past" pos="0.5 0 0">{slides}<geom mass="4" contype="0" conaffinity="0"/></body>{bodies}'
        "</worldbody></mujoco>"
    )


def test_constants_are_inserted_and_folded_and_masses_divided_by() -> None:
    laws = [{
        "on": "object_1", "constants": {"c": 3.0, "side": 0, "none": 0.0},
        "let": {"drag": "c*2", "on": "1 if side else 0"},
        "force": ["-drag*vx + none*x + on*y", "c if side else x", "0"],
    }]  # fmt: skip
    assert statement_of(model(laws)) == {
        "acceleration": {
            "object_1": {"x": "(object_1_push_x + -6*object_1_vx)/2", "y": "(object_1_push_y + object_1_x)/2"}
        }
    }


def test_hidden_bodies_become_states_and_only_those_that_matter() -> None:
    laws = [
        {"on": "object_1", "with": {"p": "past"}, "force": ["p_vx - p_y", "0", "0"]},
        {"on": "past", "with": {"o": "object_1"}, "force": ["o_x - x", "8*t", "0"]},
    ]
    assert statement_of(model(laws))["state"] == {
        "past_vx": {"start": 0.0, "rate": "(object_1_x - past_x)/4"},
        "past_x": {"start": 0.5, "rate": "past_vx"},
        "past_y": {"start": 0.0, "rate": "past_vy"},
        "past_vy": {"start": 0.0, "rate": "8*t/4"},
    }


def test_a_reaction_is_stated_and_laws_of_a_rim_and_absent_laws_are_not() -> None:
    laws = [
        {"on": "past", "with": {"o": "object_1"}, "force": ["x - o_x", "0", "0"], "reaction": "o"},
        {"on": "object_1", "factor": 0, "force": ["1", "1", "0"]},
        {"on": "object_1", "with": {"gate": "gate"}, "force": ["-1000*x", "gate_z", "0"]},
    ]
    gate = '<body name="gate"><joint type="slide" axis="0 0 1"/><geom mass="1" contype="0" conaffinity="0"/></body>'
    found = statement_of(model(laws, gate))["acceleration"]["object_1"]
    assert found == {"x": "(object_1_push_x + -(past_x - object_1_x))/2", "y": "object_1_push_y/2"}


def test_equal_names_of_two_laws_keep_their_meanings() -> None:
    laws: list[dict[str, Any]] = [
        {"on": "object_1", "let": {"r": "2*x"}, "force": ["r", "0", "0"]},
        {"on": "object_1", "let": {"r": "2*y"}, "force": ["0", "r", "0"]},
        {"on": "object_1", "let": {"r": "2*y"}, "force": ["0", "-r", "0"]},
    ]
    assert statement_of(model(laws)) == {
        "acceleration": {"object_1": {"x": "(object_1_push_x + r)/2", "y": "(object_1_push_y + r2 + -r2)/2"}},
        "let": {"r": "2*object_1_x", "r2": "2*object_1_y"},
    }


@pytest.mark.parametrize(
    ("bodies", "options", "why"),
    [
        ("", 'gravity="0 0 -9.81"', "gravity"),
        ("", 'timestep="0.005"', "gravity"),
        ('<body><joint type="slide" axis="1 0 0" stiffness="3"/></body>', 'gravity="0 0 0"', "stiffness"),
        ('<body name="b"><joint type="free"/></body>', 'gravity="0 0 0"', "b moves otherwise"),
        ('<body name="b"><joint type="slide" axis="1 1 0"/></body>', 'gravity="0 0 0"', "axis 1 1 0"),
        ('<body name="b"><joint type="slide" axis="1 0 0"/><geom mass="1"/></body>', 'gravity="0 0 0"', "b collides"),
    ],
)
def test_a_model_in_which_more_than_laws_acts_has_no_statement(bodies: str, options: str, why: str) -> None:
    with pytest.raises(UnstatableLawError, match=why):
        law_model(model([], bodies, options))


def test_a_law_that_is_too_long_to_be_compared_has_no_statement() -> None:
    laws = [{"on": "object_1", "force": ["+".join(["x"] * 100), "0", "0"]}] * 6
    with pytest.raises(UnstatableLawError, match="is refused: it has 7848 characters"):
        law_model(model(laws))


def expressions() -> st.SearchStrategy[Node]:
    leaves = st.sampled_from([Node("name", text="a"), Node("name", text="b")]) | st.sampled_from(
        [Node("number", text=text) for text in ("0", "1", "2", "0.5")]
    )

    def deeper(part: st.SearchStrategy[Node]) -> st.SearchStrategy[Node]:
        pairs = st.tuples(st.sampled_from(["+", "-", "*", "/", "**", "and", "or", "min"]), part, part)
        return (
            pairs.map(lambda made: Node(made[0], made[1:]))
            | part.map(lambda one: Node("negative", (one,)))
            | part.map(lambda one: Node("not", (one,)))
            | st.tuples(part, part, part).map(lambda parts: Node("if", parts))
            | st.tuples(part, part).map(lambda parts: Node("compare", parts, "<"))
        )

    return st.recursive(leaves, deeper, max_leaves=8)


def value(node: Node, a: float, b: float) -> float | None:
    try:
        return float(LANGUAGE.compiled(NAMES, [node])(a, b)[0])
    except (ArithmeticError, ValueError):
        return None


@given(expressions(), st.sampled_from([0.7, 2.5]), st.sampled_from([-1.3, 3.0]))
def test_folding_and_writing_keep_the_value_of_an_expression(node: Node, a: float, b: float) -> None:
    wanted = value(node, a, b)
    again = LANGUAGE.read(written(node), NAMES)
    assert value(again, a, b) == wanted
    if wanted is not None and abs(wanted) < 1e6:
        assert value(folded(node), a, b) == pytest.approx(wanted, rel=1e-5, abs=1e-5)


def solution_of(scene: int) -> ModuleType:
    files = find_pack(scene)
    spec = importlib.util.spec_from_file_location(f"solution_{scene}", files.solution)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("scene", OPEN)
def test_the_constants_of_a_structure_give_the_drawn_law(scene: int) -> None:
    """Inserts the true structure and constants, without a fit; the result must be the law of the engine."""
    files = find_pack(scene)
    pack, structures = read_pack(files), solution_of(scene).STRUCTURES
    for seed in range(1, 9):
        knobs = draw_knobs(files, pack, seed)
        names = [name if name in knobs else "phase" for name in structures[knobs["kind"]]]
        constants = {name: float(str(knobs[name])) for name in names}
        true = statement_of(drawn_mjcf(files, pack, knobs, canonical=False))
        assert law_with(files, pack, str(knobs["kind"]), constants) == true
        assert StatedLaw(true, [f"object_{one.object_id}" for one in pack.objects.values()]).length < 150


@pytest.mark.extended
def test_a_reference_states_the_law_that_fits_its_readings_and_none_without_a_reading() -> None:
    files = find_pack(201)
    assert inferred_law(files, []) is None

    def solve(_prompt: str) -> Protocol:
        """Guess."""
        yield [call("step", duration=1)]
        yield [answer([1, 2, 3])]

    protocol = stating(files, solve)("")
    assert next(protocol) == [call("step", duration=1)]
    (answered,) = protocol.send([{"sim_time": 1}])
    assert answered.arguments["answer"] == [1, 2, 3]
    assert StatedLaw(answered.arguments["law"], ["object_1"]).components == [("object_1", "x"), ("object_1", "y")]
