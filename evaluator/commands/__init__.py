"""The commands of `physment-eval`, a module for each family. They print; `__main__` turns errors into exit codes."""
