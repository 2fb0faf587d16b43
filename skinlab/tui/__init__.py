"""The bedside terminal UI: chooses a source and listeners, and nothing else."""
