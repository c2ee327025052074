"""Compute the items of stages in processes or on a Dask cluster, lock output folders, and report progress."""
