"""One episode: the contracts of participants and players, the loop, the tools, the connection to a laboratory."""
