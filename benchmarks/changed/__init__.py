"""Graded hidden changes between flights of several vehicles, and seasons: what `changed` and `trend` find of them."""
