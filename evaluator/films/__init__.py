"""Films: replays of stored episodes whose visible content is kept in small files."""
