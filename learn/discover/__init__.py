"""A law for what the catalogue has no name for: atoms, a search among them that knows its false alarms, a file."""
