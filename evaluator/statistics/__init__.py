"""What the numbers of a run are worth: intervals, paired tests, repeated tries, budget curves. Knows no runs.

The unit is the scene. Seeds and epochs of one scene resemble each other, so wherever a scene gives several episodes the
methods here take scenes, not episodes, as the sample; within a single scene its episodes are. Which method, when, by
which formula, and from which source: `docs/explanation/statistics.md`.
"""
