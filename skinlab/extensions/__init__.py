"""What can be added to the program, kind by kind: a table of it, and the rules that all obey."""
