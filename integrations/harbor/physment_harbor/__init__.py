"""Creates task folders for the Harbor framework.

Each task is one variant of a scene. Its reference solution makes the experiments. Its grade is computed from the
laboratory's log.
"""
