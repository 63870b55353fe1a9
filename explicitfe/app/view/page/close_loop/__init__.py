"""The report of a closed loop: one page that a person understands in a minute."""
