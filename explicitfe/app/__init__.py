"""The application: command line, pictures, pages, verification and tools."""
