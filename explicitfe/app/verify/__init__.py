"""Claims of the page "Is it true?": each is computed and compared with a reference."""
