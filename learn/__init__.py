"""From flights to models: measured wrench, residuals, parameters of effects, Gaussian processes."""
