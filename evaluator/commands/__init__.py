"""The commands of `physment-eval`, one module for each. `program` converts their errors to exit codes."""
