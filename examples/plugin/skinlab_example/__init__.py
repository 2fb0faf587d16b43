"""One extension of each kind for skinlab: docs/extending.md of skinlab explains them."""
