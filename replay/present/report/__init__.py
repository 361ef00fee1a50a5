"""The report of a search: one self-contained HTML page.

`contents` finds everything out, `staircase` the error step by step, `charts` draws, `page` writes the HTML with
`markup`, which escapes whatever it is given.
"""
