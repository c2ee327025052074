"""Solvers of the linear systems of flow."""
