"""Gaussian processes: fitted, calibrated, judged, stored."""
