"""What a reference protocol is written with: calls of public tools. Each yield of `solve` is one iteration.

    def solve(task):
        \"\"\"Weigh the puck with one known push.\"\"\"
        readings = yield [call("apply_force", object_id="object_1", force_vector=[2, 0, 0]), call("step", duration=0.1)]
        ...
        yield [answer(value)]

What comes back from a yield is a list with one dict for each call: the structured result, or `{"error": sentence}` if
the call was refused, or `{}` if it was not run.
"""

from collections.abc import Callable, Generator, Mapping
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from typing import Any

from scenes.draw import KnobValue
from scenes.errors import PackError
from scenes.folder import PackFiles
from scenes.pack import Scalar

ANSWER = "answer"

Reading = dict[str, Any]
AnswerValue = Scalar | list[Scalar]


@dataclass(frozen=True, slots=True)
class Call:
    """A call of a public tool."""

    tool: str
    arguments: dict[str, Any] = field(default_factory=dict[str, Any])


Protocol = Generator[list[Call], list[Reading], None]


@dataclass(frozen=True, slots=True)
class Solution:
    """What `solution.py` defines."""

    solve: Callable[[str], Protocol] | None
    """Reference protocol: takes the opening prompt, yields calls, receives readings."""
    theory: Callable[[Mapping[str, KnobValue]], AnswerValue] | None
    """Closed form of the answer from the true parameters."""
    measure: Callable[[Any, Mapping[str, KnobValue]], AnswerValue] | None
    """The answer from a privileged run: takes the drawn world and the true parameters."""


def call(tool: str, **arguments: Any) -> Call:
    """A call of a tool."""
    return Call(tool, arguments)


def answer(value: AnswerValue) -> Call:
    """The final answer."""
    return Call(ANSWER, {"answer": value})


def load_solution(files: PackFiles) -> Solution:
    """Run a pack's `solution.py`. Only for packs the user named: this executes their code.

    Raises:
        PackError: There is none, or it cannot be imported.
    """
    path = files.solution
    spec = spec_from_file_location(f"physment_solution_{files.scene_id}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise PackError(path, "no such file: this pack has no reference protocol")
    module = module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise PackError(path, f"cannot be imported: {error!r}") from error
    return Solution(*(getattr(module, name, None) for name in ("solve", "theory", "measure")))
