"""The command line: options, console, one file for each command."""
