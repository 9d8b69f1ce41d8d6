"""The server: an environment for each session, and the application."""
