"""The machine and its operating system: signals, files, memory."""
