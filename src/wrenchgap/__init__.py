"""Names the physical effect that a flying vehicle's model is missing, from its flight logs."""
