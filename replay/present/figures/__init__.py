"""How pictures look (`style`), the vehicle from above, and panels of pictures that have many."""
