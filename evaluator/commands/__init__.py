"""The commands of `physment-eval`, one module for each. They print; `__main__` turns errors into exit codes."""
