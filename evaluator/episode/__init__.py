"""One episode: the protocols of participants and players, the loop, the tools, and the connection to a server."""
