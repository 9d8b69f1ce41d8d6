"""What an episode is worth to a trainer: its grade, less its cost. Pure functions; knows neither episodes nor keys."""

from dataclasses import dataclass
from enum import StrEnum

from evaluator.records import Grade, Verdict


class Worth(StrEnum):
    """Which part of a grade counts."""

    STRICT = "strict"
    """1 if the answer is strictly correct, otherwise 0."""
    GRADED = "graded"
    """The share of sub-answers within tolerance, from 0 to 1."""


@dataclass(frozen=True, slots=True)
class RewardRule:
    """How a reward follows from a grade."""

    worth: Worth = Worth.STRICT
    per_iteration: float = 0.0
    """Taken off for each iteration."""
    per_call: float = 0.0
    """Taken off for each tool call, refused ones included."""

    def reward(self, grade: Grade, iterations: int, calls: int) -> float:
        """The reward of one episode; below 0 if it cost more than its answer is worth.

        Args:
            grade: The grade of its answer.
            iterations: Replies of the agent.
            calls: Tool calls that reached the laboratory.

        Raises:
            ValueError: The grade has no verdict.
        """
        if grade.strict is Verdict.UNSCORED or grade.graded is None:
            raise ValueError("an episode without a verdict has no reward")
        worth = float(grade.strict is Verdict.CORRECT) if self.worth is Worth.STRICT else grade.graded
        return worth - self.per_iteration * iterations - self.per_call * calls
