"""Measured curves: datasets, read, checked and turned into SI."""
