"""Printed by `make generated`; not to be edited."""
