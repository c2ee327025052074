"""How the items of a stage are computed: processes, a Dask cluster, locks, progress. No physics."""
