"""Measure human skin at the bedside."""

__version__ = "0.1.0"
