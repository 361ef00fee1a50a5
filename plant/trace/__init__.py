"""What numpy code does, written down as a tape of scalar operations: from there to compiled code and to C."""
