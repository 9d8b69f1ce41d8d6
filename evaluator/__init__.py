"""The client side: opens laboratory sessions over MCP, lets agents play, grades, scores and reports.

Knows MCP and the packs. Only `evaluator.certify` may know the server's code and the engine.
"""
