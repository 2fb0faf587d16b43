"""The precomputed finite-element database: build, store, verify, interpolate."""
