"""Standard gravity, the one value that every layer uses."""

GRAVITY = 9.80665
"""[m/s^2]; CGPM 1901, by definition."""
