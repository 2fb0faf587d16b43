"""Results for readers: text, and later files."""
