"""Compliance of a coated block in plane strain by finite elements, an independent reference for `contact.layered`."""

import numpy as np
import skfem
from skfem.helpers import ddot, eye, sym_grad, trace

import femseal as fs


def with_ratio(ratio):
    """A substrate with ν = 0.3 and G = 1, and a layer with ν = 0.37 and G = ratio."""
    return fs.Solid(2 * 1.3, 0.3), fs.Solid(2 * 1.37 * ratio, 0.37)


def block_compliance(ratio, t):
    """Amplitude of the displacement under cos(x) of pressure, of a layer of thickness t on a deep block in plane strain.

    Finite elements on half a wave, whose ends are planes of symmetry.
    """
    in_layer = np.linspace(0, t, 2 + int(np.ceil(4 * min(t, 4))))
    if t > 4:
        in_layer = np.r_[np.linspace(0, 4, 17), np.linspace(4, t, 9)[1:]]
    below = t + 12.0 * (np.geomspace(1, 25, 18) - 1) / 24
    z = -np.r_[in_layer, below[1:]][::-1]
    mesh = skfem.MeshQuad.init_tensor(np.linspace(0, np.pi, 11), z)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementQuad2()), intorder=4)
    is_layer = basis.global_coordinates()[1] > -t
    substrate, layer = with_ratio(ratio)
    shear = np.where(is_layer, layer.shear_modulus, substrate.shear_modulus)
    poisson = np.where(is_layer, layer.poisson, substrate.poisson)
    lame = 2 * shear * poisson / (1 - 2 * poisson)

    @skfem.BilinearForm
    def elasticity(u, v, w):
        strain = sym_grad(u)
        stress = 2 * w.shear * strain + w.lame * eye(trace(strain), 2)
        return ddot(stress, sym_grad(v))

    @skfem.LinearForm
    def pressure(v, w):
        return -np.cos(w.x[0]) * v[1]

    @skfem.Functional
    def amplitude(w):
        return -2 / np.pi * np.cos(w.x[0]) * w.u[1]

    top = skfem.FacetBasis(
        mesh, basis.elem, facets=mesh.facets_satisfying(lambda x: np.abs(x[1]) < 1e-9), intorder=6
    )
    matrix = elasticity.assemble(basis, shear=shear, lame=lame)
    load = pressure.assemble(top)
    sides = basis.get_dofs(lambda x: (np.abs(x[0]) < 1e-9) | (np.abs(x[0] - np.pi) < 1e-9))
    bottom = basis.get_dofs(lambda x: np.abs(x[1] - z[0]) < 1e-9)
    fixed = np.union1d(sides.all(["u^1"]), bottom.all())
    u = skfem.solve(*skfem.condense(matrix, load, D=fixed))
    return amplitude.assemble(top, u=top.interpolate(u))
