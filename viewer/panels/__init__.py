"""Tabs of every page: scene, export, notes. Sessions bring others (`Capabilities.panels`)."""
