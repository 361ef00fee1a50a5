"""`python -m wrenchgap`: the command line."""

from wrenchgap.replay.cli.main import main

main()
