"""All experiments: `python -m benchmarks.paper`."""

from __future__ import annotations

from benchmarks.paper.running import EXPERIMENTS, main

if __name__ == "__main__":
    main(EXPERIMENTS)
