"""Sound in a tube of varying section: chain matrices, losses, formants; independent of geometry and results."""
