"""The headline claims of the page "Is it true?", each computed anew on this machine beside what it is compared with."""
