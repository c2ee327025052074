"""Solve the linear systems of the flow by multigrid, elimination, pyamg or a sparse factorisation."""
