"""Error models: one a file, each with its declaration ERROR_MODEL; they add up."""
