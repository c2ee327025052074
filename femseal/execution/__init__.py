"""Compute stages in several processes or on a Dask cluster, lock output folders, and report progress."""
