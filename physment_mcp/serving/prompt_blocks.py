"""Blocks of the opening prompt: limits, instruments, the form of the answer, and the tools as text.

The first three depend on the pack. The list of tools is for agents that have no native tool calls.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from physment_mcp.tools.base import Tool
from scenes import AnswerForm, AnswerKind, Instruments, LabLimits, PublicPack, PublicQuantity, SystematicBounds


def laboratory_blocks(scene: PublicPack) -> list[str]:
    """Return the blocks on limits and instruments; none for a pack that states neither."""
    blocks: list[str] = []
    if scene.limits is not None:
        rules = "\n".join(f"- {rule}" for rule in _limits(scene.limits))
        blocks.append(
            f"# Limits\n\n{rules}\n\nA call that would go beyond a limit is refused, says what is left, and changes"
            " nothing."
        )
    if scene.instruments is not None:
        rules = "\n".join(f"- {rule}" for rule in _instruments(scene.instruments))
        blocks.append(
            f"# Instruments\n\n{rules}\n\nWhatever is computed from readings is as fine as they are. Objects are put"
            " to places no more finely than positions are read."
        )
    return blocks


def _limits(limits: LabLimits) -> list[str]:
    rules: list[str] = []
    for name, limit, unit in (("Forces", limits.force, "N"), ("Torques", limits.torque, "N·m")):
        if limit is not None:
            rules.append(
                f"{name}: at most {limit:g} {unit} on an object." if limit else f"{name}: none can be applied."
            )
    if limits.created_mass is not None:
        rules.append(f"Created objects: at most {limits.created_mass:g} kg in all; what is deleted does not come back.")
    if limits.lab_time is not None:
        rules.append(f"Laboratory time: {limits.lab_time:g} s.")
    if limits.calls is not None:
        rules.append(f"Calls: {limits.calls}; refused calls count, `answer` does not.")
    return rules


def _instruments(instruments: Instruments) -> list[str]:
    rules: list[str] = []
    for name, unit in (("position", "m"), ("velocity", "m/s"), ("angle", "rad"), ("spin", "rad/s")):
        resolution = getattr(instruments, name)
        noise = getattr(instruments.noise, name) if instruments.noise else 0
        parts = [f"a resolution of {resolution:g} {unit}"] if resolution else []
        parts += [f"a random error with a standard deviation of {noise:g} {unit}"] if noise else []
        if parts:
            rules.append(f"{_PLURALS[name]}: {' and '.join(parts)}.")
    if instruments.noise is not None:
        rules.append("A second reading at the same moment repeats the first; errors at different moments differ.")
    return [*rules, *_systematic(instruments)]


def _systematic(instruments: Instruments) -> Iterator[str]:
    """Yield a sentence that states the bounds of the systematic error of positions, and one for angles, if any."""
    bounds = (instruments.bias or SystematicBounds(), instruments.drift or SystematicBounds())
    for name, plural, unit in (("position", "positions", "m"), ("angle", "angles", "rad")):
        bias, drift = (getattr(one, name) for one in bounds)
        if bias or drift:
            begins = f"between -{bias:g} and {bias:g} {unit}" if bias else "0"
            rate = f"changes at a constant rate between -{drift:g} and {drift:g} {unit}/s"
            yield (
                f"The instrument for {plural} also adds an error, which is the same for all objects and which you are"
                f" not told. Each coordinate of it is {begins} when the clock shows 0, and"
                f" {rate if drift else 'stays so'}. Questions are about true values."
            )


_PLURALS = {
    "position": "Positions, each coordinate",
    "velocity": "Velocities, each component",
    "angle": "Angles",
    "spin": "Spins",
}


def answer_block(form: AnswerForm | None, problem_type: str) -> str:
    """Return the block on the form of the answer and its tolerance.

    Args:
        form: The form that the pack states; None for a pack of the published prototype, which states none.
        problem_type: Type of the problem, which determines the form if the pack states none.
    """
    if form is None:
        usual = _tolerance(AnswerForm(kind=AnswerKind.NUMBER))
        by_type = {
            "comparison": "the id or number the task asks for.",
            "observation": "the number of the case the task asks for.",
            "computation": f"a list of numbers in the order of the task. {usual}",
        }
        return f"# Answer\n\nAnswer with {by_type.get(problem_type, f'{_NUMBER}. {usual}')}"
    if form.kind is AnswerKind.NUMBER:
        return f"# Answer\n\nAnswer with {_NUMBER} ({_unit(form.unit)}). {_tolerance(form)}"
    if form.kind is AnswerKind.NUMBERS:
        units = (form.unit,) * len(form.labels) if isinstance(form.unit, str) or form.unit is None else form.unit
        parts = [f"{label} ({_unit(unit)})" for label, unit in zip(form.labels, units, strict=False)]
        order = f", in this order: {'; '.join(parts)}" if parts else ""
        return (
            f"# Answer\n\nAnswer with a list of numbers, each with at least three significant digits{order}."
            f" {_tolerance(form)}"
        )
    if form.kind in {AnswerKind.CHOICE, AnswerKind.OBJECTS}:
        return f"# Answer\n\nAnswer with exactly one of: {', '.join(form.options)}."
    if form.kind is AnswerKind.FORMULA:
        return f"# Answer\n\n{_formula(form)}"
    return "# Answer\n\nAnswer in one sentence of at most ten words, in the words of the task."


def steps_block(steps: Sequence[PublicQuantity]) -> list[str]:
    """Return the block on intermediate quantities that an agent may add to its answer; none if there are none."""
    if not steps:
        return []
    lines = "\n".join(f"- `{step.name}`: {step.meaning} ({_unit(step.unit)})." for step in steps)
    return [
        "# Steps\n\nIn the argument `steps` of `answer` you may also state what you found on the way, as numbers by"
        f" these names. It is looked at apart and does not change whether your answer is right.\n\n{lines}"
    ]


LAW_BLOCK = (
    "# Law\n\nIn the argument `law` of `answer` you may also state the law that you believe: the acceleration of each"
    " object as expressions of time, places, velocities and what you apply, in SI units. It is graded apart, by what it"
    " predicts in other situations, and does not change whether your answer is right. A law that cannot be read is"
    " refused, and then the answer is not given."
)
"""Block on the law that may be stated with the answer, in scenes that ask for one."""


def _formula(form: AnswerForm) -> str:
    variables = "; ".join(
        f"{name}, {variable.meaning} ({_unit(variable.unit)}), from {variable.range[0]:g} to {variable.range[1]:g}"
        for name, variable in form.variables.items()
    )
    return (
        f"Answer with a formula ({_unit(form.unit)}) in these variables: {variables}. Write numbers, the variables, pi,"
        " + - * / ^ and brackets, and the functions sqrt, exp, log (natural), sin, cos, tan, asin, acos, atan, tanh and"
        f" abs, without an equals sign. {_tolerance(form).replace('A number', 'It', 1)} That must hold in the whole"
        " range of the variables."
    )


_NUMBER = "a number with at least three significant digits, without its unit"


def _tolerance(form: AnswerForm) -> str:
    within = [f"{100 * form.rel_tol:g} %"] if form.rel_tol else []
    unit = f" {form.unit}" if isinstance(form.unit, str) and form.unit != "1" else ""
    within += [f"{form.abs_tol:g}{unit}"] if form.abs_tol else []
    return (
        f"A number counts as right within {' plus '.join(within) or 'rounding'} of what this laboratory really gives,"
        " even where an ideal one would give something else."
    )


def _unit(unit: str | tuple[str, ...] | None) -> str:
    return f"in {unit}" if isinstance(unit, str) and unit != "1" else "no unit"


def tool_listing(tools: Iterable[Tool[Any]]) -> str:
    """List the tools: the signature and description of each, and below them its arguments and results."""
    return "\n".join(_entry(tool) for tool in tools)


def _entry(tool: Tool[Any]) -> str:
    arguments, results = tool.input_schema(), tool.output_schema()
    required = set(arguments.get("required", ()))
    fields: Mapping[str, Any] = arguments.get("properties", {})
    defined: Mapping[str, Any] = arguments.get("$defs", {}) | results.get("$defs", {})
    signature = ", ".join(
        f"{name}: {_type(field, defined)}" + ("" if name in required else f" = {json.dumps(field.get('default'))}")
        for name, field in fields.items()
    )
    lines = [f"- `{tool.name}({signature})`: {tool.description}"]
    lines += [
        f"  - `{name}`: {field['description']}"
        for name, field in fields.items()
        if field.get("description") and name != _OBJECT
    ]
    returned = [
        f"`{name}: {_type(field, defined)}`" + (f" {field['description']}" if field.get("description") else "")
        for name, field in results.get("properties", {}).items()
        if name not in _EVERYWHERE
    ]
    return "\n".join([*lines, f"  - Returns {' · '.join(returned)}"] if returned else lines)


_OBJECT = "object_id"
"""An argument of many tools, which the prompt explains once."""
_EVERYWHERE = {"sim_time", "results"}
"""Fields that are not listed, because all results have them or they contain no information."""


def _type(field: Mapping[str, Any], defined: Mapping[str, Any]) -> str:
    """Format the type of a field, as `number`, `[number × 3]`, `{x: number, y: number}` or `string or integer`.

    Args:
        field: Its JSON Schema.
        defined: The schemas that a `$ref` may name, from `$defs`.

    Raises:
        KeyError: The schema names no type; each argument and result must have one.
    """
    if "$ref" in field:
        return _type(defined[field["$ref"].removeprefix("#/$defs/")], defined)
    if "anyOf" in field:
        return " or ".join(_type(option, defined) for option in field["anyOf"])
    if "enum" in field:
        return " or ".join(map(json.dumps, field["enum"]))
    if field["type"] == "array":
        size = (
            f" × {field['minItems']}" if field.get("minItems") == field.get("maxItems") and "minItems" in field else ""
        )
        return f"[{_type(field['items'], defined)}{size}]"
    if field.get("properties"):
        return "{" + ", ".join(f"{name}: {_type(part, defined)}" for name, part in field["properties"].items()) + "}"
    return str(field["type"])
