"""Privileged checks of scenes: the one room of the client side that may know the server's code and the engine."""
