"""Static checks of a pack: a sentence for each fault, with its remedy."""

import difflib
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from typing import Any, cast

from pydantic import BaseModel

from evaluator.answers.engine import TOOL_NAMES
from evaluator.certify import compiled_model, drawn_parts
from evaluator.certify.catches import undeclared_catches
from evaluator.certify.determined import family_faults
from evaluator.certify.difficulty import concept_faults
from evaluator.certify.keys import answer_faults, unstated
from physment_mcp.errors import SceneError
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from scenes import (
    CANARY,
    USUAL_TIMESTEP_S,
    Category,
    Pack,
    PackError,
    PackFiles,
    draw_knobs,
    drawn_mjcf,
    read_pack,
)
from scenes.draw import step_values
from scenes.law_statements import UnstatableLawError, law_model
from scenes.protocol import KIND, drawn_kind, load_solution

REVEALING_WORDS = frozenset(
    {"hollow", "solid", "heavy", "light", "rough", "smooth", "elastic", "inelastic", "hidden", "long", "short"}
    | {"stiff", "soft", "slippery", "sticky"}
)
"""Words in the name of an object that would reveal one of its properties."""
_TOLD = {
    "cord": "cord|rope|thread|string|wire|line|band",
    "spring": "spring|sprung",
    "rod": "rod|arm|bar|pole|shaft|axle",
    "rail": "rail|guide|track|groove|ramp",
    "pulley": "pulley",
}
"""Kind of a part of the schematic → words by which a task mentions it."""
_VARIANTS = 20
"""Number of seeds that are compiled if the parts or the forces of a model depend on the draw."""
_PLACING = ("move_object", "change_position", "create_objects", "attach_objects")
_EDITS = ("create_objects", "attach_objects", "delete_objects")


def lint(files: PackFiles) -> list[str]:
    """The faults of a pack that can be found without running it; empty if there are none."""
    try:
        pack = read_pack(files)
        mjcf = drawn_mjcf(files, pack, draw_knobs(files, pack, 0), canonical=True)
        Session(load_scene(files.scene_id, 0, files.folder.parent))
        found = [sentence for rule in _RULES for sentence in rule(files, pack, mjcf)]
        return found + list(_model_faults(files, pack, mjcf))
    except (PackError, SceneError) as error:
        return [str(error)]
    except ValueError as error:
        return [f"{files.mjcf}: does not compile: {' '.join(str(error).split())}"]


def _unknown_fields(files: PackFiles, _pack: Pack, _mjcf: str) -> Iterator[str]:
    """Report unknown keys: they are ignored when a pack is read, so a typing error would go unnoticed."""
    raw = json.loads(files.json.read_text(encoding="utf-8"))
    yield from _unknown(raw, Pack, "")


def _unknown(raw: Any, model: type[BaseModel], where: str) -> Iterator[str]:
    for key in raw:
        if key not in model.model_fields:
            near = cast("list[str]", difflib.get_close_matches(key, list(model.model_fields), 1))
            yield f"unknown field {where}{key}" + (f"; did you mean {near[0]}?" if near else "; nothing reads it")
    for key, field in model.model_fields.items():
        inner = _model_inside(field.annotation)
        value = raw.get(key)
        if inner is None or not isinstance(value, dict):
            continue
        nested = cast("dict[str, Any]", value)
        if _is_mapping(field.annotation):
            for name, entry in nested.items():
                yield from _unknown(entry, inner, f"{where}{key}.{name}.")
        else:
            yield from _unknown(nested, inner, f"{where}{key}.")


def _model_inside(annotation: Any) -> type[BaseModel] | None:
    options = [annotation, *getattr(annotation, "__args__", ())]
    return next((option for option in options if isinstance(option, type) and issubclass(option, BaseModel)), None)


def _is_mapping(annotation: Any) -> bool:
    return getattr(annotation, "__origin__", None) is dict


def _incomplete(_files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    for name in ("category", "concepts", "answer_spec", "expected_behavior", "reasoning", "requires", "knobs"):
        if not getattr(pack, name):
            yield f"{name} is missing or empty"
    if pack.concepts:
        yield from concept_faults(pack)
    if pack.canary != CANARY:
        yield f"canary must be {CANARY}, so that training corpora can leave the pack out"
    if pack.number_of_objects != len(pack.objects):
        yield f"number_of_objects is {pack.number_of_objects}, but {len(pack.objects)} objects are listed"


def _answer(files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    step_values(files, pack, draw_knobs(files, pack, 0))
    yield from answer_faults(pack)


def _solution(files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    try:
        solution = load_solution(files)
    except PackError as error:
        yield str(error)
        return
    for name in ("solve", "measure", *(("structure", "fit", "naive", "batch") if pack.predicts else ())):
        if getattr(solution, name) is None:
            yield f"solution.py defines no {name}"
    if solution.structure is drawn_kind and KIND not in {*pack.knobs, *pack.derive}:
        yield f"solution.py defines no structure, and no drawn value is named {KIND}"
    if pack.predicts and not solution.stages:
        yield "solution.py defines no stage: write the most direct attempt to bring about what is asked"
    if pack.family:
        yield from family_faults(pack, solution)


def _undeclared(_files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    """Report catches and families that the task mentions and the pack lacks; certificates 11 and 12 would skip them."""
    if not pack.predicts:
        return
    if not pack.family and pack.category is not Category.OPEN:
        yield "family is missing: state the laws that are possible, so that certificate 12 can test what decides them"
    for word in undeclared_catches(pack):
        yield f"the task tells of {word!r}, but no catch has it among its words, so certificate 11 does not test it"


def _laboratory(_files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    if pack.predicts:
        yield from unstated(pack)


def _objects(_files: PackFiles, pack: Pack, mjcf: str) -> Iterator[str]:
    listed = {f"object_{entry.object_id}" for entry in pack.objects.values()}
    wanted = {f"object_{number}" for number in range(1, len(listed) + 1)}
    if listed != wanted:
        yield f"objects are numbered {', '.join(sorted(listed))}; number them from object_1 on without gaps"
    yield from (
        f"body {body} can move but is no object: list it, so that agents can name it"
        for body in sorted(compiled_model.movable(mjcf) - listed)
        if body.startswith("object_")
    )
    for key in pack.object_permissions:
        if key.removesuffix("_permissions") not in pack.objects:
            yield f"object_permissions.{key} belongs to no object"
    for key, entry in pack.objects.items():
        if f"{key}_permissions" not in pack.object_permissions:
            yield f"object_permissions.{key}_permissions is missing: everything about {key} would be withheld"
        words = REVEALING_WORDS & set(re.split(r"[\W_]+", entry.name.lower()))
        if words:
            yield f"the name {entry.name!r} of {key} reveals a property: {', '.join(sorted(words))}; use a neutral noun"
        answerable = pack.answer_spec is not None and key in pack.answer_spec.options
        if pack.permissions_of(key).hidden and not answerable and re.search(rf"\b{key}\b", pack.metadata.task):
            yield f"the task names {key}, which is hidden"


def _schematic(_files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    known = {key for key in pack.objects if not pack.permissions_of(key).hidden}
    for number, part in enumerate(pack.schematic):
        if not re.search(rf"\b(?:{_TOLD[part.kind]})s?\b", pack.metadata.task):
            yield f"schematic.{number} is a {part.kind}, of which the task does not tell"
        yield from (
            f"schematic.{number} names {point}, which an agent does not know from the start"
            for point in part.points
            if isinstance(point, str) and point not in known
        )


def _task(_files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    task = pack.metadata.task
    for tool in TOOL_NAMES:
        if "_" in tool and tool in task:
            yield f"the task names the tool {tool}: describe the laboratory, not the recipe"
    for number in re.findall(r"\bobject_(\d+)\b", task):
        if f"object_{number}" not in pack.objects:
            yield f"the task names object_{number}, which is not listed"


def _tools(_files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    for tool, reason in pack.disabled_tools.items():
        if tool not in TOOL_NAMES:
            yield f"disabled_tools names {tool}, which is no tool"
        if not reason.strip():
            yield f"disabled_tools.{tool} gives no reason"
    for tool in pack.requires:
        if tool not in TOOL_NAMES:
            yield f"requires names {tool}, which is no tool"
        if tool in pack.disabled_tools:
            yield f"requires names {tool}, which the scene disables"
    if pack.instruments and (pack.instruments.bias or pack.instruments.drift):
        placing = [tool for tool in _PLACING if tool not in pack.disabled_tools]
        if placing:
            yield f"disable {', '.join(placing)}: bodies would be put relative to positions with a systematic error"


def _hidden(_files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    category = pack.category.value if pack.category else ""
    hidden = [key for key in pack.objects if pack.permissions_of(key).hidden]
    if category.endswith("hidden"):
        if not hidden:
            yield "a hidden scene has no hidden object"
        open_to_fakes = [tool for tool in _EDITS if tool not in pack.disabled_tools]
        if open_to_fakes:
            yield f"disable {', '.join(open_to_fakes)}: a created body must not replace the hidden one"
    elif hidden:
        yield f"{hidden[0]} is hidden, but the category is {category}"


def _knobs(files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    laws = [law.model_dump(by_alias=True) for law in pack.laws]
    present = [element.get("present") for element in _written(files).iter()]
    written = json.dumps([pack.derive, pack.apply, pack.accept_draw, laws, present], default=list)
    for name, knob in pack.knobs.items():
        if not knob.meaning:
            yield f"knobs.{name}.meaning is missing: say what it is, with its unit"
        if not re.search(rf"\b{re.escape(name)}\b", written):
            yield f"knobs.{name} is used nowhere"
        bounds = knob.uniform or knob.log_uniform
        if bounds and isinstance(knob.canonical, int | float) and not bounds[0] <= knob.canonical <= bounds[1]:
            yield f"knobs.{name}.canonical lies outside the range {list(bounds)}"
        if knob.choice and knob.canonical not in knob.choice:
            yield f"knobs.{name}.canonical is none of the choices"


def _written(files: PackFiles) -> ET.Element:
    """Return the XML as the author wrote it, including the `present` conditions of its elements."""
    return ET.fromstring(files.mjcf.read_text(encoding="utf-8"))  # noqa: S314 - the user's pack


def _present(files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    listed = {f"object_{entry.object_id}" for entry in pack.objects.values()}
    yield from (
        f"{body.get('name')} has the attribute present, but an object must be there at every seed"
        for body in _written(files).iter("body")
        if body.get("name") in listed and "present" in body.attrib
    )


def _variants(files: PackFiles, pack: Pack, _mjcf: str) -> Iterator[str]:
    """Report the first variant that cannot be set up, for example because a tendon refers to an absent joint."""
    is_conditional = bool(pack.laws) or any("present" in element.attrib for element in _written(files).iter())
    if not is_conditional and not pack.predicts:
        return
    for seed in range(1, _VARIANTS):
        try:
            Session(load_scene(files.scene_id, seed, files.folder.parent))
        except (PackError, SceneError) as error:
            yield f"seed {seed} cannot be set up: {error}"
            return
    if pack.predicts:
        yield from drawn_parts.model_faults(files, pack)


def _law(_files: PackFiles, pack: Pack, mjcf: str) -> Iterator[str]:
    """Report an open world that asks for a law although no grader can compare it."""
    if pack.law_answer:
        try:
            law_model(mjcf)
        except UnstatableLawError as error:
            yield f"category open asks agents for the law, and it cannot be graded: {error}"


def _model_faults(files: PackFiles, pack: Pack, mjcf: str) -> Iterator[str]:
    if abs(compiled_model.timestep(mjcf) - USUAL_TIMESTEP_S) > 1e-12:
        yield f'the time step is {compiled_model.timestep(mjcf)} s; scenes use timestep="{USUAL_TIMESTEP_S}"'
    if "<!--" in files.mjcf.read_text(encoding="utf-8"):
        yield "the XML has comments: they could hold hints, so put what readers should know into reasoning"
    yield from compiled_model.jointless_parts(mjcf)
    yield from compiled_model.overridden(mjcf, balls_may_come="create_objects" in pack.requires)
    rewritten = drawn_mjcf(files, pack, draw_knobs(files, pack, 0), canonical=False)
    yield from (
        f"the XML as written differs from the canonical knobs in {name}"
        for name in compiled_model.differences(mjcf, rewritten)
    )


_RULES: tuple[Callable[[PackFiles, Pack, str], Iterator[str]], ...] = (
    _unknown_fields,
    _incomplete,
    _answer,
    _solution,
    _undeclared,
    _laboratory,
    _objects,
    _schematic,
    _task,
    _tools,
    _hidden,
    _knobs,
    _present,
    _variants,
    _law,
)
