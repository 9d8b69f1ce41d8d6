"""Parsing of expressions, by one thread at a time.

Before 3.11.8, Python counts the depth of an expression that it parses for all threads together, and a thread that loses
its turn in between, because objects are freed, finds another's count: `ast.parse` ends in a SystemError (gh-106905).
"""

from threading import RLock

PARSING = RLock()
"""Held while expressions are parsed, here or in a library."""
