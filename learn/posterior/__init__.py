"""A posterior over sets of effects: which are missing together, what else would do, and how sure that is."""
