"""Generate the reference page of a package's public names from its source: signatures, docstrings, errors.

The generator parses the source instead of inspecting objects. So it prints each signature as the author wrote it, and
finds the docstrings beneath fields.
"""

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any, TypeGuard

_HEAD = """\
# The public names

Made from the docstrings by `pytest tests/test_references.py --update-goldens`; do not edit.
[How to use the packages as libraries](../how-to/use-as-a-library.md) shows them at work. Everything that is not on this
page may change without notice.
"""
_SECTIONS = ("Args", "Returns", "Raises", "Source")
Function = ast.FunctionDef | ast.AsyncFunctionDef
Definition = ast.ClassDef | Function
LINE = 100
"""Largest length of a signature on one line [characters]."""


def api_page(packages: tuple[ModuleType, ...]) -> str:
    """The text of the page.

    Args:
        packages: Packages whose `__all__` is documented.
    """
    parts = [_HEAD]
    for package in packages:
        parts += [f"## `{package.__name__}`", _text((package.__doc__ or "").split("\n\n")[0])]
        for name in package.__all__:
            parts += [f"### `{package.__name__}.{name}`", *_described(package, name)]
    return "\n\n".join(part.strip("\n") for part in parts) + "\n"


def _described(package: ModuleType, name: str) -> Iterator[str]:
    value: Any = getattr(package, name)
    if not (inspect.isclass(value) or inspect.isfunction(value)):
        yield f"`{name}: {type(value).__name__}`. {_constant(package, name)}"
        return
    tree = ast.parse(Path(inspect.getsourcefile(value) or "").read_text(encoding="utf-8"))
    (node,) = (part for part in tree.body if isinstance(part, Definition) and part.name == value.__name__)
    if isinstance(node, ast.ClassDef):
        yield from _class(node)
    else:
        yield from _function(node)


def _constant(package: ModuleType, name: str) -> str:
    """Return the docstring beneath the assignment of a name, in the first module of the package that assigns it."""
    assigned = re.compile(rf"^{name}(:.*)? = ", re.MULTILINE)
    for path in sorted(Path(str(package.__file__)).parent.rglob("*.py")):
        if assigned.search(source := path.read_text(encoding="utf-8")):
            for field, said in _assigned(ast.parse(source).body):
                if field.startswith((f"{name}:", f"{name} =")) and said:
                    return _text(said)
    raise LookupError(f"{package.__name__}.{name} has no docstring")


def _class(node: ast.ClassDef) -> Iterator[str]:
    bases = ", ".join(ast.unparse(base) for base in node.bases)
    yield f"```python\nclass {node.name}{f'({bases})' if bases else ''}\n```"
    yield from _docstring(node)
    methods = [part for part in node.body if _is_function(part) and not part.name.startswith("_")]
    fields = [(field, said) for field, said in _assigned(node.body) if not field.startswith(("_", "model_config"))]
    fields += [(_property(part), ast.get_docstring(part) or "") for part in methods if _is_property(part)]
    if fields:
        yield "\n".join(f"- `{field}`" + (f": {_text(said)}" if said else "") for field, said in fields)
    for part in methods:
        if not _is_property(part):
            yield from _function(part)


def _is_function(part: ast.stmt) -> TypeGuard[Function]:
    return isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef)


def _is_property(part: Function) -> bool:
    return any(ast.unparse(mark) == "property" for mark in part.decorator_list)


def _property(part: Function) -> str:
    return f"{part.name}: {ast.unparse(part.returns) if part.returns else 'Any'}"


def _assigned(body: list[ast.stmt]) -> Iterator[tuple[str, str]]:
    """Return the fields or constants assigned in a body, each with the docstring beneath it; empty without one."""
    for statement, following in pairwise([*body, ast.Pass()]):
        said = ""
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            said = str(following.value.value)
        match statement:
            case ast.AnnAssign(target=ast.Name(id=name), annotation=annotation, value=value):
                default = "" if value is None or _is_call(value) else f" = {ast.unparse(value)}"
                yield f"{name}: {ast.unparse(annotation)}{default}", said
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                yield f"{name} = {ast.unparse(value)}", said
            case _:
                pass


def _is_call(value: ast.expr) -> bool:
    """Return whether a default is a call, such as `Field(…)`, which is omitted from the page."""
    return isinstance(value, ast.Call)


def _function(node: Function) -> Iterator[str]:
    yield f"```python\n{_signature(node)}\n```"
    yield from _docstring(node)


def _signature(node: Function) -> str:
    """Return the signature of a definition; a long one gets one line per parameter."""
    start = f"{'async ' if isinstance(node, ast.AsyncFunctionDef) else ''}def {node.name}"
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    parameters = [
        # `ast` writes a default without spaces.
        re.sub(r"^(\w+: .+?)=", r"\1 = ", parameter)
        for parameter in re.split(r", (?![^\[]*\])", ast.unparse(node.args))
        if parameter not in {"self", "cls"}
    ]
    line = f"{start}({', '.join(parameters)}){returns}"
    if len(line) > LINE:
        line = f"{start}(\n" + "".join(f"    {parameter},\n" for parameter in parameters) + f"){returns}"
    return line.replace("'", "")  # around the names of types that are imported late


def _docstring(node: Definition) -> Iterator[str]:
    """The paragraphs of a docstring; its sections become lists."""
    for block in re.split(r"\n{2,}", inspect.cleandoc(ast.get_docstring(node) or "")):
        title, _, rest = block.partition("\n")
        word, _, said = title.partition(":")
        if word not in _SECTIONS:
            yield _text(block)
        elif word in {"Returns", "Source"}:
            yield f"*{word}:* {_text(f'{said} {rest}')}"
        else:
            yield f"*{word}:*\n\n" + "\n".join(_entries(textwrap.dedent(rest)))


def _entries(text: str) -> Iterator[str]:
    """Parse the entries of a section: a name, a colon, and a text that may continue on indented lines."""
    for entry in re.split(r"\n(?! )", text):
        name, _, said = entry.partition(":")
        yield f"- `{name}`: {_text(said)}"


def _text(text: str) -> str:
    return " ".join(text.split())
