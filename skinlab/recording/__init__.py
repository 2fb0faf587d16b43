"""What is kept of a visit: journal, session, seal, audit trail."""
