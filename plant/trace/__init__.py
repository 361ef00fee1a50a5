"""From numpy code to a tape of scalar operations, and from there to compiled code and C."""
