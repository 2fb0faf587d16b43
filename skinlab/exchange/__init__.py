"""Files in from other software, and out to it."""
