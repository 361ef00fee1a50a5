"""Vehicles whose laws have other forms than the catalogue's, explained."""
