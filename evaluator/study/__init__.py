"""Running the matrix of a run: participants, limits, workers and shards; also merging, forking and replay."""
