"""Studies: the matrix of a run, who plays it, within which limits, on which share of the machines."""
