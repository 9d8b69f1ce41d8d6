"""The reference agent: plays the protocol of a pack through the public tools, which shows that it can be solved."""

from dataclasses import dataclass
from pathlib import Path

from evaluator.agents.protocol_player import ProtocolPlayer
from evaluator.episode.player import Briefing
from evaluator.errors import AgentError
from evaluator.records.episode import EpisodeKey
from scenes import PackError, find_pack
from scenes.protocol import load_solution
from scenes.world_names import reference_of


@dataclass(frozen=True, slots=True)
class ReferenceAgent:
    """Plays the protocol in `solution.py` of the scene."""

    scenes_dir: Path | None = None
    """Folder of scene packs; None for the suite."""
    name: str = "reference"
    """Name in records and tables."""

    def player(self, key: EpisodeKey, briefing: Briefing) -> ProtocolPlayer:
        """Start the protocol of the scene.

        Raises:
            AgentError: The pack has no protocol.
        """
        try:
            solve = load_solution(find_pack(key.scene, self.scenes_dir)).solve
        except PackError as error:
            raise AgentError(f"no reference protocol: {error}") from error
        if solve is None:
            raise AgentError(f"no reference protocol: solution.py of scene {reference_of(key.scene)} defines no solve")
        return ProtocolPlayer(solve, briefing.prompt)
