"""The tabs of the page that show results: each asks one part of the session, and writes with `present`."""
