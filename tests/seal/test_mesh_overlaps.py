"""Overlapping elements of a mesh: the search by trees against a comparison of all pairs."""

import tracemalloc
from itertools import product

import numpy as np
import pytest
from skfem import MeshQuad, MeshTri

from femseal.seal import mesh_overlaps
from femseal.seal.mesh_overlaps import first_overlap_at_boundary


def overlap_of_all_pairs(mesh):
    """The first element at the boundary that overlaps another, and the first element that it overlaps."""
    corners = mesh.p.T[mesh.t.T]
    for i, j in product(np.unique(mesh.f2t[0, mesh.boundary_facets()]), range(mesh.nelements)):
        if i != j and not are_separated(corners[i], corners[j]):
            return i, j
    return ()


def are_separated(first, second):
    """Whether two convex polygons overlap by at most a tenth of the smaller one, across one of their edges."""
    for polygon in (first, second):
        for edge in np.roll(polygon, -1, axis=0) - polygon:
            along = [corners @ (edge[1], -edge[0]) for corners in (first, second)]
            overlap = min(x.max() for x in along) - max(x.min() for x in along)
            if overlap <= 0.1 * min(np.ptp(x) for x in along):
                return True
    return False


def graded(rng, n):
    """Coordinates from 0 to 1 of n intervals, whose lengths may be very different."""
    lengths = np.exp(rng.uniform(0, 3) * rng.standard_normal(n))
    return np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum()


def two_parts(rng, kind):
    """A mesh of two parts, one of which is of another size, turned and moved."""
    one, two = (
        kind.init_tensor(graded(rng, rng.integers(1, 6)), graded(rng, rng.integers(1, 6)))
        for _ in range(2)
    )
    turn = rng.choice([0.0, rng.uniform(0, 7)])
    size = np.exp(rng.uniform(-4, 1))
    c, s = size * np.cos(turn), size * np.sin(turn)
    moved = np.array([[c, -s], [s, c]]) @ two.p + rng.uniform(-1, 1, (2, 1))
    return kind(np.hstack([one.p, moved]), np.hstack([one.t, two.t + one.nvertices]))


@pytest.mark.parametrize("kind", [MeshTri, MeshQuad])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e6])
def test_the_same_elements_overlap_as_by_comparison_of_all_pairs(kind, scale, monkeypatch):
    # few pairs at a time, so that there are several parts
    monkeypatch.setattr(mesh_overlaps, "_PAIRS_AT_ONCE", 5)
    rng = np.random.default_rng(1)
    overlapping = 0
    for _ in range(40):
        mesh = two_parts(rng, kind)
        mesh = kind(scale * mesh.p, mesh.t)
        expected = overlap_of_all_pairs(mesh)
        assert first_overlap_at_boundary(mesh) == expected
        overlapping += bool(expected)
    assert 10 < overlapping < 30


def test_a_large_element_over_many_small_ones_is_found():
    small = MeshTri.init_tensor(*2 * [np.linspace(0.4, 0.6, 200)])
    corners = np.array([[0.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
    last = small.nvertices + np.arange(3)[:, None]
    mesh = MeshTri(np.hstack([small.p, corners]), np.hstack([small.t, last]))
    first, second = first_overlap_at_boundary(mesh)
    assert second == small.nelements
    assert first == np.unique(mesh.f2t[0, mesh.boundary_facets()])[0]


def test_the_search_among_thin_elements_takes_little_memory():
    """Along the diagonal, the bounding box of an element a thousand times as long as wide overlaps hundreds of others."""
    across = MeshQuad.init_tensor(np.linspace(0, 1, 1001), np.array([0.0, 1.0]))
    mesh = MeshQuad(np.array([[1.0, -1.0], [1.0, 1.0]]) @ across.p, across.t)
    tracemalloc.start()
    assert first_overlap_at_boundary(mesh) == ()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 50e6
