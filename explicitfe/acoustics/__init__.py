"""Sound in a tube of varying section: chain matrices, losses, formants. It knows no geometry and no results."""
