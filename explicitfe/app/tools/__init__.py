"""Tools of the command line: diagnosis, lists, new scenarios, speed."""
