"""The commands of `physment-mcp` besides serving one episode on stdio, a module each."""
