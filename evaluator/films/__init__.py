"""Films: replays of stored episodes, whose visible content is stored in small files."""
