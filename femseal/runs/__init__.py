"""A case, run: read and checked, forecast, mapped over processes or a cluster, kept so that it can go on."""
