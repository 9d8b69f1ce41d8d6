"""The commands of `physment-mcp`, one module each. Without a command, the program serves one episode on stdio."""
