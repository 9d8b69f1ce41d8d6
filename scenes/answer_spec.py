"""The field `answer_spec` of a pack: the form of the answer and how it is graded.

`scenes.public` decides which of its fields the laboratory may see.
"""

from enum import StrEnum
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

Scalar = float | int | str
"""A single value: a number or a text."""


class AnswerKind(StrEnum):
    """The kind of an answer, which determines how it is graded."""

    NUMBER = "number"
    NUMBERS = "numbers"
    CHOICE = "choice"
    OBJECTS = "objects"
    TEXT = "text"
    FORMULA = "formula"


class _SpecModel(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, use_attribute_docstrings=True)


class Variable(_SpecModel):
    """A variable of a formula."""

    meaning: str
    """The quantity that the variable stands for."""
    unit: str
    """Unit of the variable; `1` for a pure number."""
    range: tuple[float, float]
    """Smallest and largest value for which the formula must hold."""

    @model_validator(mode="after")
    def _ascending(self) -> Self:
        if not self.range[0] < self.range[1]:
            msg = f"the range {list(self.range)} is empty: the first bound must be below the second"
            raise ValueError(msg)
        return self


class AnswerSpec(_SpecModel):
    """Kind, unit, options and tolerance of the answer."""

    kind: AnswerKind
    """The kind of the answer, which determines how it is graded."""
    unit: str | tuple[str, ...] | None = None
    """Unit of a number, or one unit for each of several numbers; `1` for a pure number."""
    labels: tuple[str, ...] = ()
    """Meaning of each of several numbers, in order; shown to the agent."""
    abs_tol: float = Field(default=0.0, ge=0)
    """Absolute tolerance, in the unit of the answer; adds to the relative one. If it is 0 and the key is 0, 0.01 is
    used."""
    rel_tol: float = Field(default=0.05, ge=0)
    """Relative tolerance: |answer - key| <= abs_tol + rel_tol |key|."""
    options: tuple[str, ...] = ()
    """The possible answers of a choice or of objects, shown to the agent."""
    variables: dict[str, Variable] = {}
    """The variables of a formula by name; shown to the agent."""
    accept: tuple[str, ...] = ()
    """Regular expressions for wordings of the right answer that normalised grading accepts. Private."""
