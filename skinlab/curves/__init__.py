"""Curves and what was asked of the pump: programs, pressure paths, CSV, campaigns."""
