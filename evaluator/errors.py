"""What can go wrong on the client side, and what follows from it.

EvaluatorError
├─ UsageError             the operator asked for something impossible      → one sentence, exit code 2
├─ StoreError             a run folder cannot be read or written           → one sentence, exit code 2
├─ AgentError             the agent cannot go on                           → recorded as the episode's outcome
└─ InfrastructureError    server or connection failed                      → the episode is retried, never scored wrong
   └─ PermanentFailure    … and asking again cannot help                   → the agent's other episodes are left out
"""

from evaluator.records import Usage


class EvaluatorError(Exception):
    """Root of the errors this package raises on purpose."""


class UsageError(EvaluatorError):
    """The operator asked for something impossible; one sentence."""


class StoreError(EvaluatorError):
    """A run folder cannot be read or written; one sentence."""


class AgentError(EvaluatorError):
    """The agent cannot go on; one sentence.

    Args:
        sentence: Why.
        usage: What the reply used that could not be taken.
    """

    def __init__(self, sentence: str, usage: Usage | None = None) -> None:
        super().__init__(sentence)
        self.usage = usage


class InfrastructureError(EvaluatorError):
    """The server or the connection to it failed; one sentence."""


class PermanentFailure(InfrastructureError):
    """Asking again cannot help: the key is refused, there is no such model, credit is used up, a setting is refused."""
