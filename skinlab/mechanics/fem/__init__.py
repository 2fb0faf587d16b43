"""Axisymmetric finite elements at finite strain for the suction of a skin layer."""
