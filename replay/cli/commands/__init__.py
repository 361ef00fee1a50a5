"""One module per command, with a function of its name. A module is found by being here; nothing else lists them."""
