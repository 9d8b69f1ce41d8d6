"""Answers: how they are read, compared with the key, and where the key comes from."""
