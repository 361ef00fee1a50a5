"""What a flight is, and how it is read and written; no physics."""
