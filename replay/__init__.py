"""The application: the loop as functions (`api`), compensation, counterfactuals, reports, command line."""

from wrenchgap._lazy import callable_as

callable_as(__name__, "replay_compensation")
