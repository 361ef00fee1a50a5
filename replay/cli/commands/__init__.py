"""One module per command, each with `register(app)`. A module is found by being here; nothing else lists them."""
