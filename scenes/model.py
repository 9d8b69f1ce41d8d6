"""Builds the model of a scene: inserts sampled values and laws into its XML, and removes absent elements.

Works on XML text; only MuJoCo interprets the elements.
"""

import hashlib
import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from typing import Any

from scenes.answer_spec import Scalar
from scenes.draw import KnobValue, evaluate
from scenes.errors import PackError
from scenes.folder import PackFiles
from scenes.pack import Expression, Law, Pack

_PRESENT = "present"
"""Attribute with a condition on the knobs. If it is false, the element is removed from the model."""
_LAWS = "laws"
"""Name of the model's custom text that holds the laws, as JSON with the drawn constants."""
_STEP = re.compile(r"(?P<tag>\w+)(?:\[(?P<name>[^\]]+)\])?")
_NAME = re.compile(r"\b[^\W\d]\w*")
_SALT = re.compile(r'(?<=<text name="noise_salt" data=")[^"]*')
"""Matches the content of the model's custom text that determines the noise of its instruments."""
_NAMING = ("name", "joint", "site", "geom", "tendon", "body")
"""Attributes that may identify an element: its own name, or the element that an entry of a tendon refers to."""


class _TargetError(ValueError):
    """A target does not name exactly one attribute of the model; the message says why."""


def drawn_mjcf(files: PackFiles, pack: Pack, values: Mapping[str, KnobValue], *, canonical: bool) -> str:
    """Return the model's XML text with the values of a seed.

    Args:
        files: The files of the pack.
        pack: The pack.
        values: As returned by `draw_knobs`.
        canonical: True for the values of seed 0, which the XML contains as written.

    Raises:
        PackError: The XML is missing or not XML, a target of `apply` does not name exactly one element, or an
            expression is wrong.
    """
    try:
        text = files.mjcf.read_text(encoding="utf-8")
    except (FileNotFoundError, UnicodeDecodeError) as error:
        raise PackError(files.mjcf, "no such file, or not UTF-8") from error
    if canonical and not pack.laws and f"{_PRESENT}=" not in text:
        return text
    try:
        root = ET.fromstring(text)  # noqa: S314 - packs are local files the operator named
    except ET.ParseError as error:
        raise PackError(files.mjcf, f"not XML: {error}") from error
    if not canonical:
        _apply(files, pack, values, root)
    _leave_out_absent(files, values, root)
    _add_laws(files, pack, values, root)
    return ET.tostring(root, encoding="unicode")


def noise_of_seed(mjcf: str, seed: int) -> str:
    """Return the model of a world with the instrument noise of a seed. The seeds of a world differ only in this noise.

    A text of the model, the salt, determines the noise. Models without a salt are returned unchanged.
    """
    if seed == 0:
        return mjcf
    return _SALT.sub(lambda salt: hashlib.sha256(f"{salt[0]}:{seed}".encode()).hexdigest()[:16], mjcf)


USUAL_TIMESTEP_S = 0.005
"""Time step of the paper and of the suite [s]."""


def timestep_of(files: PackFiles) -> float:
    """Return the time step of a model, or MuJoCo's default [s].

    Raises:
        PackError: The model cannot be read.
    """
    try:
        root = ET.fromstring(files.mjcf.read_text(encoding="utf-8"))  # noqa: S314 - packs are local files the operator named
        option = root.find("option")
        return float("0.002" if option is None else option.get("timestep", "0.002"))
    except (OSError, ET.ParseError, ValueError) as error:
        raise PackError(files.mjcf, f"no time step can be read: {error}") from error


def changed_mjcf(mjcf: str, changes: Mapping[str, Scalar | tuple[Scalar, ...]], without: Collection[str] = ()) -> str:
    """Return a model with other values, or without some of its elements.

    Args:
        mjcf: The model's XML text.
        changes: Target as in `apply`, such as `joint[rail].frictionloss` → its new value or list of values.
        without: Elements to remove, such as `joint[stop]`.

    Raises:
        ValueError: A target does not name exactly one element.
    """
    root = ET.fromstring(mjcf)  # noqa: S314 - the pack that the operator named
    for target, value in changes.items():
        element, attribute = _find_attribute(root, target)
        element.set(attribute, " ".join(map(_as_text, value if isinstance(value, tuple) else (value,))))
    for path in without:
        _remove(root, _find_element(root, path))
    return ET.tostring(root, encoding="unicode")


def _apply(files: PackFiles, pack: Pack, values: Mapping[str, KnobValue], root: ET.Element) -> None:
    for target, expressions in pack.apply.items():
        field = f"apply.{target}"
        try:
            element, attribute = _find_attribute(root, target)
        except _TargetError as error:
            raise PackError(files.json, f"field {field}: {error}") from error
        parts = expressions if isinstance(expressions, tuple) else (expressions,)
        element.set(attribute, " ".join(_as_text(evaluate(files, field, part, values)) for part in parts))


def _leave_out_absent(files: PackFiles, values: Mapping[str, KnobValue], root: ET.Element) -> None:
    """Remove the elements whose condition is false, and remove the conditions."""
    for element in list(root.iter()):
        condition = element.attrib.pop(_PRESENT, None)
        field = f"{_PRESENT} of <{element.tag}> in {files.mjcf.name}"
        if condition is not None and not evaluate(files, field, condition, values):
            _remove(root, element)


def _add_laws(files: PackFiles, pack: Pack, values: Mapping[str, KnobValue], root: ET.Element) -> None:
    """Write all laws into the model; those that are disabled at the seed have the factor 0.

    Omitting them would shorten each step, and the duration of a step would reveal the number of laws.
    """
    drawn = [
        _drawn_law(law, values)
        | {"factor": float(bool(evaluate(files, f"laws.{number}.present", law.present, values)))}
        for number, law in enumerate(pack.laws)
    ]
    if drawn:
        custom = ET.SubElement(root, "custom")
        ET.SubElement(custom, "text", {"name": _LAWS, "data": json.dumps(drawn)})


def _drawn_law(law: Law, values: Mapping[str, KnobValue]) -> dict[str, Any]:
    """Return a law with the values of the knobs in its expressions."""
    drawn: dict[str, Any] = law.model_dump(by_alias=True, exclude={"present"}, exclude_none=True)
    for field in ("force", "torque"):
        drawn[field] = [str(part) for part in drawn[field]]
    named = set(_NAME.findall(" ".join((*law.let.values(), *drawn["force"], *drawn["torque"]))))
    drawn["constants"] = {
        name: value for name, value in values.items() if name in named and isinstance(value, int | float)
    }
    return drawn


def _as_text(value: Expression) -> str:
    return value if isinstance(value, str) else repr(value)


def _find_attribute(root: ET.Element, target: str) -> tuple[ET.Element, str]:
    path, dot, attribute = target.rpartition(".")
    if not dot or not attribute.isidentifier():
        raise _TargetError("write targets as tag[name].attribute, or tag[name]/tag[name].attribute")
    return _find_element(root, path), attribute


def _find_element(root: ET.Element, path: str) -> ET.Element:
    found = [root]
    for number, step in enumerate(path.split("/")):
        match = _STEP.fullmatch(step)
        if match is None:
            raise _TargetError("write targets as tag[name].attribute, or tag[name]/tag[name].attribute")
        tag, name = match["tag"], match["name"]
        # The first step may match any element of the model, each further step a child of the elements found before.
        inside = [child for element in found for child in (element.iter(tag) if number == 0 else element.findall(tag))]
        # In further steps, an entry of a tendon is identified by the element that it refers to.
        naming = _NAMING[:1] if number == 0 else _NAMING
        found = [element for element in inside if name is None or name in map(element.get, naming)]
    if len(found) != 1:
        raise _TargetError(f"names {len(found)} elements of the model, not one")
    return found[0]


def _remove(root: ET.Element, element: ET.Element) -> None:
    # ElementTree elements have no reference to their parents. A child of a removed element is not in the tree any more.
    for parent in root.iter():
        if element in list(parent):
            parent.remove(element)
            return
