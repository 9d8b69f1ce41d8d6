"""The referee: opens episodes for a trainer and returns a reward after each. It holds the answer keys."""
