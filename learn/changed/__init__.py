"""What changed between flights: effects as changes on suspect flights, everything absolute as a nuisance."""
