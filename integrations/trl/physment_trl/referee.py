"""Episodes that a referee opens on a host and grades. A call is one POST."""

import contextlib
from typing import Any

from physment_laboratory import Laboratory, LaboratoryError
from physment_referee import OpenedEpisode, Referee, RefereeError

from physment_trl.environment import EpisodeLost, LaboratoryEnvironment

PATIENCE_S = 600.0
"""Longest time to wait until the referee can open another episode [s]."""


class PhysMent(LaboratoryEnvironment):
    """Plays on the host of the referee that `PHYSMENT_REFEREE_URL` and `PHYSMENT_REFEREE_TOKEN` name."""

    def _open(self, wanted: dict[str, Any]) -> "RefereedEpisode":
        """Open an episode. While the referee is at its limit of open episodes, wait and retry.

        Raises:
            RefereeError: The referee refused, cannot be reached, or stayed at its limit for ten minutes.
        """
        referee = Referee.from_environment()
        return RefereedEpisode(referee, referee.open_when_free(PATIENCE_S, **wanted))


class RefereedEpisode:
    """An open episode of a referee."""

    def __init__(self, referee: Referee, opened: OpenedEpisode) -> None:
        """Store the episode; the first call connects."""
        self.prompt = opened.prompt
        self._referee, self._opened = referee, opened
        self._laboratory = Laboratory(opened.mcp_url, opened.player_token)

    def call(self, tool: str, arguments: dict[str, Any]) -> tuple[str, bool]:
        """Call a tool, as `OpenEpisode.call`."""
        try:
            result = self._laboratory.call(tool, arguments)
        except LaboratoryError as error:
            raise EpisodeLost(str(error)) from error
        return result.text, not result.is_error

    def reward(self, calls: int) -> float:
        """Return the reward. TRL does not tell an environment how many replies there were, so a call counts as one."""
        self._laboratory.close()
        try:
            found = self._referee.reward(
                self._opened.episode_id, self._opened.owner_token, iterations=calls, end="budget_exhausted"
            )
        except RefereeError as error:
            raise EpisodeLost(str(error)) from error
        return found.reward

    def close(self) -> None:
        """Close the connection and the episode."""
        self._laboratory.close()
        with contextlib.suppress(RefereeError):  # the referee may have closed it already
            self._referee.close(self._opened.episode_id, self._opened.owner_token)
