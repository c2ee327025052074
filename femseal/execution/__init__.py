"""How the items of a stage are computed: processes, a cluster, parts of a run, locks, progress. No physics."""
