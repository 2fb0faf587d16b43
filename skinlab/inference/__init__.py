"""The inverse problem: from a curve to the skin's parameters."""
