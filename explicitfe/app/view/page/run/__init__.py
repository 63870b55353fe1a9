"""The report of runs: one page with an animation, charts and the checks of each result."""
