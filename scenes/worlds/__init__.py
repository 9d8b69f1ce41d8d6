"""Worlds generated from a grammar of laws, with records that certify them.

Handles arithmetic, text and random numbers. Depends on neither MCP nor MuJoCo, and has no code for agents or verdicts.
"""
