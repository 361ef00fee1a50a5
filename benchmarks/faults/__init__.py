"""Damaged files of every kind that the tool reads: each is read, recovered and counted, or refused in one line.

`valid` makes small valid files, `mutations` and `structured` damage them, `opening` opens one and says what came of it,
`workers` opens many in child processes with limits of time and memory, `page` is the table in docs/reliability.md.
"""
