"""Files: written whole, for their owner only; HDF5, TOML and JSON that may be damaged."""
