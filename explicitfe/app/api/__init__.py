"""The commands as Python functions: thin, with the types that a Python user expects. The work is done by the packages below."""
