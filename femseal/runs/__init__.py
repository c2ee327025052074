"""A run of a case: reading and checking, forecast, mapping over processes or a cluster, checkpoint."""
