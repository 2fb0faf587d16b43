"""The simulated probe."""
