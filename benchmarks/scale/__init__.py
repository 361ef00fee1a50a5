"""What thousands of logs cost: a fleet of generated flights on a local cluster; docs/scale.md."""
