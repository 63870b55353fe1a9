"""Compiled kernels and the host: everything that knows neither mechanics nor files of results."""
