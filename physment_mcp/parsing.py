"""Parsing of expressions, by one thread at a time.

Before 3.11.8, Python counts the nesting of an expression once for all threads. If two threads parse at the same time,
`ast.parse` can end in a SystemError (gh-106905).
"""

from threading import RLock

PARSING = RLock()
"""Held while expressions are parsed, here or in a library."""
