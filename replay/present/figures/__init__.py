"""Figures of the results, with matplotlib: `plot(result, axes)` draws into axes, `save` writes a PNG."""
