"""Whether a curve is fit to be used."""
