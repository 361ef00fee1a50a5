"""Coverage-guided fuzzing of what reads files (atheris, of the development set; docs/decisions/0024-atheris.md).

`python -m benchmarks.faults.fuzz` goes through `targets.TARGETS` in turns, from the corpus kept beside this file. What
ends in anything but a value or one line is kept in a folder of findings, and the search goes on.
"""
