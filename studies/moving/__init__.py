"""Bodies in motion: the silicone beam, sealed cases of a beam that shares no code with the package, and their judge."""
