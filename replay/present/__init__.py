"""How results read: every sentence, table, figure and JSON document is made here and nowhere else."""
