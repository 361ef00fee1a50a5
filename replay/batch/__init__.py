"""Thousands of logs: one command for each of them, on this machine or a Dask cluster; results in a Parquet dataset."""
