"""A case, run: its forecast, its studies, the results folder."""
