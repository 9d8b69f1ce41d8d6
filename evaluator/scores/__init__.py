"""Numbers computed from episodes: scores of one episode, of groups, of runs."""
