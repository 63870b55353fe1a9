"""Measures of a run in time from its result file; docs/reference/measures.md defines them."""
