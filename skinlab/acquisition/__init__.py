"""From a source of events to curves and results: live, replayed or recovered."""
