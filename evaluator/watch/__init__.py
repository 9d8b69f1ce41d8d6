"""Shows a run in the browser while it is played. Only reads the run folder."""
