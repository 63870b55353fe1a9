"""The report of runs: one page with each result moving in three dimensions, what it says, and whether it may be quoted."""
