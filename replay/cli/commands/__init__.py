"""The commands, each a function: parse, call `replay.api`, present. `replay.cli.main` lists them."""
