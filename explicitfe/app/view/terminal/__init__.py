"""What a person sees of results, checks and lists in a terminal; programs read the same numbers with ``--json``."""
