"""Many members of one scenario: which they are, who computes them, and what they came to, row by row."""
