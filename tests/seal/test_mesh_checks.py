"""Meshes that overlap themselves are refused, and parts and boundaries without flow are warned of."""

import numpy as np
import pytest
from skfem import MeshQuad, MeshTri

from femseal.base import InputError
from femseal.seal import (
    MeshSeal,
)
from femseal.seal.mesh_checks import boundaries_without_name, parts_without_flow


def test_parts_of_a_mesh_that_nothing_flows_through_are_warned_of():
    strip = MeshQuad.init_tensor(np.linspace(0, 2e-3, 3), np.linspace(0, 1e-3, 2))
    mesh = (
        strip + strip.translated((3e-3, 0.0)) + strip.scaled(0.5).translated((6e-3, 0.0))
    ).with_boundaries({"in": lambda x: x[0] == 0, "out": lambda x: np.isin(x[0], (2e-3, 5e-3))})
    seal = MeshSeal(mesh, "in", "out")
    assert [*parts_without_flow(mesh, *seal.ends)] == [
        "a part of the mesh around (4 mm, 500 µm), 2 of 4.5 mm², touches no inlet: nothing flows there",
        "a part of the mesh around (6.5 mm, 250 µm), 0.5 of 4.5 mm², touches neither inlet nor outlet: "
        "nothing flows there",
    ]


def test_a_hole_whose_boundary_is_in_no_group_is_said():
    """A square of 4 mm with a hole of 2 mm: its outline has 8 mm, around its middle."""
    mesh = MeshQuad.init_tensor(*(np.linspace(0, 4e-3, 5),) * 2)
    ends = {"left": lambda x: x[0] < 1e-9, "right": lambda x: x[0] > 4e-3 - 1e-9}
    sides = {"sides": lambda x: abs(x[1] - 2e-3) > 2e-3 - 1e-9}
    hole = mesh.remove_elements(
        mesh.elements_satisfying(lambda x: abs(x - 2e-3).max(axis=0) < 1e-3)
    )
    assert [*boundaries_without_name(hole.with_boundaries(ends | sides))] == [
        "a boundary of the mesh around (2 mm, 2 mm), 8 mm long, is in no group: it is closed"
    ]
    assert [*boundaries_without_name(mesh.with_boundaries(ends | sides))] == []
    assert len([*boundaries_without_name(mesh.with_boundaries(ends))]) == 2


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad])
def test_meshes_that_overlap_themselves_or_have_undefined_nodes(kind):
    """A node pushed over the opposite edge leaves each element whole, but some upside down."""
    mesh = kind.init_tensor(*2 * [np.linspace(0, 1, 5)])
    middle = int(np.argmin(np.hypot(*(mesh.p - 0.5))))
    undefined, over = mesh.p.copy(), mesh.p.copy()
    undefined[:, middle] = np.nan
    over[:, middle] = (0.9, 0.57)
    faults = [
        (undefined, mesh.t, f"^path: given a mesh whose node {middle} has no finite coordinates"),
        (mesh.p, np.hstack([mesh.t, mesh.t[:, 5:6]]), "overlap"),
    ]
    if kind is MeshTri:
        faults.append((over, mesh.t, r"^path: given a mesh whose elements \d+ and \d+ overlap"))
    for points, elements, message in faults:
        with pytest.raises(InputError, match=message):
            MeshSeal(kind(points, elements).with_boundaries(ENDS), "a", "b")


ENDS = {"a": lambda x: x[0] == 0, "b": lambda x: x[0] == 1}


def two_parts(kind, shift, turn=0.0, cells=6, size=1.0):
    """A unit square and another one with its own nodes, moved."""
    one = kind.init_tensor(*2 * [np.linspace(0, 1, 7)])
    two = kind.init_tensor(*2 * [np.linspace(0, size, cells + 1)])
    c, s = np.cos(turn), np.sin(turn)
    moved = np.array([[c, -s], [s, c]]) @ two.p + np.array(shift)[:, None]
    both = kind(np.hstack([one.p, moved]), np.hstack([one.t, two.t + one.nvertices]))
    ends = {name: one.facets_satisfying(end) for name, end in ENDS.items()}
    return both.with_boundaries(ends)


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad])
@pytest.mark.parametrize(
    ("shift", "more"),
    [
        ((0, 0), {}),
        ((1 / 3, 0), {}),
        ((0.43, 0.21), {}),
        ((0.3, 0.9), {"turn": 0.4}),
        ((0.95, 0.95), {}),
        ((0.5, -0.2), {"turn": np.pi / 4}),
        ((0.3, 0.3), {"cells": 1, "size": 0.1}),
    ],
)
def test_parts_that_lie_on_each_other_are_refused(kind, shift, more):
    """Nodes of the two parts that coincide, lie on edges, or lie anywhere; one within the other."""
    with pytest.raises(
        InputError, match=r"^path: given a mesh whose el.* (overlap|lies on others)"
    ):
        MeshSeal(two_parts(kind, shift, **more), "a", "b")


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad])
@pytest.mark.parametrize(
    "shift", [(1, 0), (1, 0.5), (1 - 1e-4, 0.37), (1, 1), (0, -1 + 1e-12), (1.5, 0.2)]
)
def test_parts_beside_each_other_are_taken(kind, shift):
    assert MeshSeal(two_parts(kind, shift), "a", "b").length == pytest.approx(1)


@pytest.mark.parametrize(("angle", "good"), [(1.9, True), (2.3, False)])
def test_a_band_that_winds_onto_itself_is_refused(angle, good):
    """All its elements lie beside their neighbours; it is a ring with a slit, or covers its beginning once more."""
    band = MeshQuad.init_tensor(np.linspace(0, 1, 4), np.linspace(0, angle * np.pi, 60))
    ends = {name: band.facets_satisfying(end) for name, end in ENDS.items()}
    r, theta = band.p
    points = (1 + r) * np.stack([np.cos(theta), np.sin(theta)])
    mesh = MeshQuad(points, band.t).with_boundaries(ends)
    if good:
        assert MeshSeal(mesh, "a", "b").length == pytest.approx(2 * angle * np.pi, rel=1e-2)
    else:
        with pytest.raises(InputError, match=r"overlap|lies on others"):
            MeshSeal(mesh, "a", "b")
