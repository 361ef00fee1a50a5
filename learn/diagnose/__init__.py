"""What is wrong, before anything is named: timing, where a model fails, what its error depends on."""
