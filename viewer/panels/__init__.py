"""Tabs of every page: the scene, what leaves the page, notes. Sessions bring others (`Capabilities.panels`)."""
