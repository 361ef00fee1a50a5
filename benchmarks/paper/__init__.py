"""The paper's experiments on a simulated VoliroX: one module each, `python -m benchmarks.paper` for all."""
