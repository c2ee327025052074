"""How the items of a stage are computed and kept: processes, a cluster, checkpoints, locks, progress. No physics."""
