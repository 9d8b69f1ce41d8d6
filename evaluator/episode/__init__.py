"""One episode: the player's contract, the loop, the tools offered, the connection to a laboratory."""
