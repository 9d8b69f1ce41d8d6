"""Storage of runs: durable files, the run folder, its seal, and the redaction of secrets."""
