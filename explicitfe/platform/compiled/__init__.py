"""What makes machine code, and knows no mechanics: compile options, vectors, arrays, threads."""
