"""Linear solvers of the flow: multigrid on the grid, elimination, pyamg and a sparse factorisation; and the choice."""
