"""Creates task folders for the Harbor framework.

Each task is one variant of a scene. It has a reference solution that makes the experiments, and is graded from the
laboratory's log.
"""
