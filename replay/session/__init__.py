"""A working session for the viewer: flights, a model that changes, and the analysis behind the page."""
