"""Pictures and page of a sweep, from the data of ``results/documents/sweep_to_draw.py``."""
