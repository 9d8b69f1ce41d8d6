"""Seals the episodes of a run while it is played, and checks the seals of stored runs."""

from collections.abc import Sequence

from evaluator.errors import StoreError
from evaluator.store.run_folder import RunFolder
from evaluator.store.seal import Seal


class Sealing:
    """The seal of a run that is being played, kept in memory alone until the end."""

    def __init__(self, folder: RunFolder, *, trust: bool = False, damage: Sequence[str] = ()) -> None:
        """Begin where a run was interrupted, or anew.

        Args:
            folder: The run, whose damaged lines have been set aside.
            trust: Go on with records that do not fit to their seal.
            damage: A sentence for each line that was set aside; the seal cannot vouch for the others then.

        Raises:
            StoreError: The records do not fit to their seal.
        """
        stored = folder.read_seal() or Seal()
        lines = folder.episode_lines()
        problem = stored.problem(lines)
        if problem and not damage:
            _refuse(folder, problem, trust=trust)
        self.seal = Seal()
        for line in lines:
            self.add(line)
        found = stored.found + max(0, len(lines) - stored.lines)
        edited = (*stored.edited, *damage, *([problem] if problem and not damage else []))
        self.seal = self.seal.model_copy(update={"found": found, "edited": edited})

    def add(self, line: bytes) -> None:
        """Seal one more episode.

        Args:
            line: Its line, without the line feed.
        """
        self.seal = self.seal.after(line)

    def sentence(self) -> str:
        """What the operator keeps elsewhere."""
        return f"seal: {self.seal.lines} episodes, {self.seal.head}"


def seal_note(folder: RunFolder, *, trust: bool = False) -> str:
    """What the seal of a stored run says, as a clause for its report.

    Args:
        folder: The run.
        trust: Go on with records that do not fit to their seal, and say so.

    Raises:
        StoreError: The records do not fit to their seal.
    """
    seal = folder.read_seal()
    if seal is None:
        return "not sealed: nothing tells whether they are as they were written"
    lines = folder.episode_lines()
    problem = seal.problem(lines)
    if problem:
        _refuse(folder, problem, trust=trust)
        return f"NOT as they were sealed: {problem}; taken all the same, as the operator asked"
    remarks = [*seal.edited]
    if seal.found:
        remarks.append(f"{seal.found} of them were sealed as they were found after the run had been killed")
    if len(lines) > seal.lines:
        remarks.append(f"{len(lines) - seal.lines} more are not sealed, because the run was killed")
    return "; ".join([f"{seal.lines} sealed, {seal.head}", *remarks])


def _refuse(folder: RunFolder, problem: str, *, trust: bool) -> None:
    folder.episodes()  # if a line cannot even be read, this says which
    if not trust:
        raise StoreError(
            f"{folder.episodes_file} is not what the run wrote: {problem}; --allow-modified goes on with it, and the"
            " report says so"
        )
