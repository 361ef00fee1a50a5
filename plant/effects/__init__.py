"""The catalogue of physical effects: one file for each, at one of five places."""
