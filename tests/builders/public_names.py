"""Checks of the public names of a package."""

import ast
import inspect
from itertools import pairwise
from pathlib import Path
from types import ModuleType


def check_public_names(package: ModuleType) -> None:
    """Check that `__all__` is sorted, that each name in it exists and is documented, and that `import *` binds them."""
    assert package.__all__ == sorted(package.__all__, key=_as_ruff_sorts)
    documented = _documented_constants(Path(str(package.__file__)).parent)
    for name in package.__all__:
        value = getattr(package, name)
        is_code = inspect.isclass(value) or inspect.isfunction(value)
        assert value.__doc__ if is_code else name in documented, name
    imported: dict[str, object] = {}
    exec(f"from {package.__name__} import *", imported)
    assert imported.keys() - {"__builtins__"} == set(package.__all__)


def _as_ruff_sorts(name: str) -> tuple[int, str]:
    """Sort key of ruff's `__all__` order: constants, then classes, then other names."""
    return (0 if name.isupper() else 1 if name[0].isupper() else 2), name


def _documented_constants(folder: Path) -> set[str]:
    """Names assigned at the top of a module with a docstring beneath."""
    found: set[str] = set()
    for path in folder.rglob("*.py"):
        for statement, following in pairwise(ast.parse(path.read_text(encoding="utf-8")).body):
            match (statement, following):
                case (ast.Assign(targets=[ast.Name(id=name)]), ast.Expr(value=ast.Constant(value=str()))):
                    found.add(name)
                case _:
                    pass
    return found
