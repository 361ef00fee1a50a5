"""Make a model file from what is known of a vehicle, and look at one."""
