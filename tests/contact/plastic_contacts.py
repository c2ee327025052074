"""Contacts of rough faces that yield: the faces, hardness that rises with the depth, and the solution."""

from rough_faces import rough_face

from femseal.contact import HalfSpace, HardnessTable, NixGao, solve_contact

E, H, D = 115e9, 4e9, 1e-6
#: E* over the pixel [Pa/m].
STIFF = E / D
RTOL = 1e-9
#: A hardness that rises with the depth: by a table, and by the law of Nix and Gao.
TABLE = HardnessTable([0.0, 0.02 * D, 0.1 * D, 0.3 * D], [0.25 * H, 0.33 * H, 0.5 * H, 0.6 * H])
NIX_GAO = NixGao(0.25 * H, 0.5 * D, 0.1 * D)


def yielding_face(shape, slope=0.25, seed=0):
    """Rough face so steep that under the loads of these tests part of its contact yields."""
    return rough_face(shape, slope, seed)


def solved_contact(gap, law, pressure, boundary="periodic", **given):
    """Contact under a law and a nominal pressure, to RTOL; `given` adds to what the solver is given, or replaces it."""
    half_space = HalfSpace(gap.shape, (D, D), E, boundary)
    return solve_contact(
        gap, half_space, **{"pressure": pressure, "hardness": law, "rtol": RTOL} | given
    )
