"""One command over thousands of logs, in parallel on this machine or on a Dask cluster (docs/batch.md)."""
