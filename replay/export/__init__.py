"""The compensation as C99, for the vehicle."""
