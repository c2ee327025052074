"""Solve the linear systems of the flow: multigrid, elimination, pyamg, sparse factorisation, and a choice of them."""
