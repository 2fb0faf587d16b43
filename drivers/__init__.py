"""The wire to a suction probe. Knows nothing of skin."""
