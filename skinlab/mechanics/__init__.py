"""The mechanics of suction: laws, finite elements, effects, model files."""
