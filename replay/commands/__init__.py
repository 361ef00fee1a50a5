"""One module per command; each has `register(app)`. A module is found by being here: nothing else lists the commands."""
