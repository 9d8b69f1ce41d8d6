"""One episode: the contracts of contenders and players, the loop, the tools, the connection to a laboratory."""
