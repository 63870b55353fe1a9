"""Parameter sweeps: the runs of one scenario, the workers that compute them, and the table of their measures."""
