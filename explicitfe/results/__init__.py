"""Results: files, measures, acoustics, and the documents that commands return."""
