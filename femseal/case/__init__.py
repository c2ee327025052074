"""A case: the TOML file of a run, its tables, and the checks of its values."""
