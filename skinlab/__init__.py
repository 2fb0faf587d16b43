"""Measure human skin at the bedside."""
