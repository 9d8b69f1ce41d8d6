"""Worlds that are drawn from a grammar of laws, with records that certify them.

Knows arithmetic, texts and random numbers. Knows no MCP, no MuJoCo, no agents and no verdicts.
"""
