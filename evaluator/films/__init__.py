"""Films: stored episodes are replayed, and what could be seen is kept in small files."""
