"""Studies: who plays the matrix of a run, within which limits, on which machines; merging and replay."""
