"""The scenario file: its tables, its reading, and sentences about what is wrong with it."""
