"""Find where model and data disagree, name what is missing, add it, show the gap shrink."""
