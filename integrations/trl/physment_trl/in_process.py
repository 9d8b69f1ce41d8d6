"""Episodes in the process of the trainer, without a host and a referee; needs the extra `in-process`.

Answer keys are then in the trainer's memory. An agent that reaches the laboratory through its tools alone cannot read
them; do not give such a process an agent that runs code.
"""

from pathlib import Path
from typing import Any, Literal

from pydantic_core import to_json

from evaluator import reward, split
from physment_mcp import RefusedCall, open_episode
from physment_trl.environment import LaboratoryEnvironment

Worth = Literal["strict", "graded", "chance_corrected"]
"""The reward of an answer, as for `physment-eval referee --reward`."""


class InProcessPhysMent(LaboratoryEnvironment):
    """Plays and grades in this process. A row names its variant by scene and seed, or by split and index."""

    def __init__(self, worth: Worth = "strict", scenes_dir: Path | None = None, law: bool = False) -> None:
        """Create the environment without an episode.

        Args:
            worth: Rule for the value of an answer, such as `strict` or `graded`.
            scenes_dir: Folder of scene packs; the suite by default.
            law: As for `LaboratoryEnvironment`.
        """
        super().__init__(law)
        self._worth, self._scenes_dir = worth, scenes_dir

    def _open(self, wanted: dict[str, Any]) -> "LocalEpisode":
        """Open an episode.

        Raises:
            ValueError: The row does not name its variant by scene and seed, or by split and index.
        """
        scene, seed = _variant(wanted)
        return LocalEpisode(scene, seed, wanted, self._worth, self._scenes_dir)


def _variant(wanted: dict[str, Any]) -> tuple[int, int]:
    named = {name: value for name, value in wanted.items() if name not in {"budget", "max_calls", "prompting"}}
    match named:
        case {"scene": scene, **rest} if rest.keys() <= {"seed"}:
            return scene, rest.get("seed", 0)
        case {"split": name, "index": index, **rest} if not rest:
            found = split(name.partition("@")[0])
            if name in {found.name, found.label} and 0 <= index < len(found.scenes) * len(found.seeds):
                return found.scenes[index % len(found.scenes)], found.seeds[index // len(found.scenes)]
        case _:
            pass
    raise ValueError(f"in process, a row names scene and seed, or split and index, of this suite, and not {named}")


class LocalEpisode:
    """An open episode of this process."""

    def __init__(self, scene: int, seed: int, wanted: dict[str, Any], worth: Worth, scenes_dir: Path | None) -> None:
        """Open an episode in this process.

        Args:
            scene: Id of the scene.
            seed: Variant of the scene.
            wanted: The row, with `budget`, `max_calls` and `prompting`.
            worth: Rule for the value of an answer, such as `strict` or `graded`.
            scenes_dir: Folder of scene packs.
        """
        self._episode = open_episode(scene, seed, max_calls=wanted.get("max_calls"), scenes_dir=scenes_dir)
        self._variant, self._worth, self._scenes_dir = (scene, seed), worth, scenes_dir
        self.prompt = self._episode.prompt_for(wanted.get("budget", 20), wanted.get("prompting", "zero-shot"))

    def call(self, tool: str, arguments: dict[str, Any]) -> tuple[str, bool]:
        """Call a tool, as `OpenEpisode.call`."""
        try:
            return to_json(self._episode.call(tool, **arguments)).decode(), True
        except RefusedCall as refusal:
            return str(refusal), False

    def reward(self, calls: int) -> float:
        """Return the reward of the answer."""
        del calls
        return float(getattr(reward(*self._variant, self._episode.answer, self._scenes_dir), self._worth))

    def close(self) -> None:
        """Do nothing: an episode in memory needs no closing."""
