"""Curves that other software exported: found by looking, said aloud, never guessed in silence."""
