"""Programs that measure wrenchgap; development only."""
