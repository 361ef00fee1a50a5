"""The meaning suite: logs with one wrong unit, frame, sign, order, clock or stuck channel each, and healthy ones."""
