"""Statistics of verdicts: intervals, paired tests, pass@k, budget curves. Knows no runs.

The sampling unit is the scene, because episodes of one scene (its seeds and epochs) are correlated. If there is only
one scene, its episodes are the sample. `docs/explanation/statistics.md` lists each method with its formula and source.
"""
