"""Numbers by which `auto` chooses a solver, and by which a choice is given up; the package docstring has the map.

A further number belongs to multigrid itself: `multigrid.COARSEST_NODES`.
"""

# --- networks of links on a grid, see `choice.solve_flow` ---

#: Largest number of nodes of a network for which elimination may be the first choice (about 4 GB at the limit).
ELIMINATED_NODES = 5_000_000
#: Largest ratio of the longer to the shorter side of a pixel for which multigrid is used. On gaps of 64² and 128²
#: pixels multigrid takes as long as elimination at ratios of 2.5 to 3.5, and 2 to 6 times as long at ratios of 4 to 12.
#: At a ratio of 28 it fails in 1 of 12 cases and once had an error of 22 %. The reason is that multigrid coarsens the
#: grid along both axes, so that the slowest error components are only found late.
LARGEST_PIXEL_RATIO = 3.5
#: Approximate number of rows of links that are sampled to estimate the pixel ratio and the contrast of neighbouring
#: links.
SAMPLED_ROWS = 64
#: Multigrid is tried first if there are more than SMOOTH_NODES exp(ROUGHNESS_GROWTH r) nodes, where r is the mean
#: difference of ln c between neighbouring links. A pair of an open and a closed link contributes CLOSED_ROUGHNESS to r.
#: On 245 networks of 24² to 512² nodes (independent links and pixels, contacts, and faces cut by a plane) this choice
#: takes 1.1 times as long on average as the faster solver.
SMOOTH_NODES, ROUGHNESS_GROWTH, CLOSED_ROUGHNESS = 15, 3.5, 4.0
#: Largest roughness r for which multigrid is tried on a slender grid, through whose narrow side the fluid flows. For
#: independent nodes with σ(ln c) of 0.5 to 2, r is 0.4 to 2, and multigrid takes 0.1 to 0.7 of the time of elimination
#: on grids of 4 × 20,000 to 100 × 10,000 nodes. If 30 % of the nodes are closed, r is above 2.5, and multigrid takes 2
#: to 40 times as long. If the fluid flows along the long side, multigrid sometimes fails.
SLENDER_ROUGHNESS = 2.2
#: Number of iterations after which multigrid is given up and elimination is used, if elimination is possible.
MULTIGRID_PATIENCE = 120
#: Largest number of iterations if the caller chose multigrid, or if elimination would need too much memory.
MOST_MULTIGRID_ITERATIONS = 600
#: Links with a conductance below this fraction of the largest conductance hardly contribute to sums of conductances. At
#: nodes that are only connected by such links, an iteration converges slowly or not at all.
CONTRIBUTING_LINK = 1e-8
#: Links with a conductance below this fraction of the largest conductance are lost by rounding in sums of conductances,
#: so that the matrix may become indefinite.
RESOLVED_LINK = 1e-13

# --- sparse matrices, see `sparse` ---

#: Number of unknowns up to which a factorisation is faster than multigrid. Times were measured on one core with P1, Q1,
#: P2 and Q2 elements. With 20,000 unknowns, factorisation takes 58 to 75 ms, and multigrid 61 to 90 ms; with 50,000
#: unknowns, 160 to 260 ms and 150 to 220 ms; with 100,000 unknowns, 350 to 650 ms and 280 to 410 ms; with 300,000
#: unknowns, 1.4 to 2.2 s and 0.9 to 1.5 s; with a million unknowns (P1), 34 s and 4.5 s. With 300,000 unknowns,
#: factorisation needs 490 to 560 MB of memory, and multigrid 200 to 320 MB.
DIRECT_UNKNOWNS = 50_000
