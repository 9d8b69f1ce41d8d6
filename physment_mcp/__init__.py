"""The laboratory: an MCP server that hosts one MuJoCo scene per episode and publishes 26 tools.

Knows no answers, agents, budgets or reports.
"""

__version__ = "0.1.0"
