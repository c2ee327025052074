"""Solve the linear systems of the flow by multigrid, elimination, pyamg or a sparse factorisation.

**Who solves what.** The form of the operator decides between the two halves of this picture::

    cells and faces;                                     seals on a mesh, or with an oblique lay;
    strips and rings whose lay is along or across        spiral grooves; permeability tensors;
    the seal                                             everything else on request ("amg", "direct")
                    |                                                     |
       grid.Stencil: four links at each node             sparse matrix, assembled by scikit-fem
                    |                                                     |
           choice.solve_flow                             sparse.solve_between_ends: an inlet and an outlet
                    |                                    sparse.solve_spd: any other right-hand side
                    |                                                     |
          +---------+---------+                                 +---------+---------+
     multigrid.py       elimination.py                        amg.py            direct.py
                        (star-mesh)                           (pyamg)           (SuperLU)

**Files of multigrid.** `multigrid` contains the iteration, and `gradient_rows` its steps on the rows of the grid.
`v_cycle` is the preconditioner. `hierarchy` builds the levels with the help of `interpolation` (from coarse to fine
nodes), `clusters` (nodes that a coarser level hardly moves) and `coarsest` (elimination of the coarsest level).

**What "auto" chooses.** The first line that applies decides. All numbers are in `thresholds`, except
COARSEST_NODES, which is in `multigrid`.

=============  =============================================================  ===================================
operator       condition                                                      solver
=============  =============================================================  ===================================
stencil        no open path, or no node between inlet and outlet              none: the potential is known
stencil        more than COARSEST_NODES nodes on the coarsest grid, that      elimination
               is, a long and narrow network; and its roughness r is above
               SLENDER_ROUGHNESS, or the fluid flows along its long side
stencil        at most ELIMINATED_NODES open nodes, and not more than         elimination
               SMOOTH_NODES exp(ROUGHNESS_GROWTH r), with the roughness r
stencil        at most ELIMINATED_NODES open nodes, and pixels longer than    elimination
               LARGEST_PIXEL_RATIO times their width
stencil        at most ELIMINATED_NODES open nodes                            multigrid; elimination after
                                                                              MULTIGRID_PATIENCE iterations
stencil        more open nodes                                                multigrid; elimination after
                                                                              MOST_MULTIGRID_ITERATIONS
sparse matrix  at most DIRECT_UNKNOWNS unknowns                               direct
sparse matrix  more unknowns                                                  amg; direct if it does not converge
=============  =============================================================  ===================================

**A solver that is chosen by its name** solves the system or raises `NotConverged`; a solver of the other half of the
picture raises `InputError`. There is one exception: on long pixels, "multigrid" gives way to elimination, because its
rigorous error bound would reject up to half of such flows. `DarcyFlow.solver` names the solver that was used.

**Multigrid and narrow links.** Links below RESOLVED_LINK are left out, and nodes that are only connected by links below
CONTRIBUTING_LINK are eliminated afterwards. The error of multigrid is bounded rigorously in networks without such
nodes. In networks with such nodes, the bound leaves out their excess, so that it is not strictly rigorous.
"""
