"""Statistics of verdicts: intervals, paired tests, pass@k and budget curves. Independent of runs.

The sampling unit is the scene, because episodes of one scene (its seeds and epochs) are correlated. If there is only
one scene, its episodes are the sample. `docs/explanation/statistics.md` gives the formula and source of each method.
"""
