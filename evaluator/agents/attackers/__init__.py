"""Generic attackers: attempts to answer without understanding, which must fail in scenes that ask for a prediction."""
