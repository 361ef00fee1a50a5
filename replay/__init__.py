"""The application: replay, counterfactuals, comparison, reports and the command line."""
