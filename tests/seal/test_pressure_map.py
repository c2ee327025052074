"""Maps of contact pressure: their shapes, their mean, fields from files, and what they refuse."""

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from skfem import MeshQuad, MeshQuad2, MeshTri, MeshTri2

from femseal import InputError
from femseal.seal import (
    AngleTable,
    Frame,
    MapsAtLoads,
    PressureField,
    Profile,
    Uniform,
    read_pressure_field,
)
from femseal.seal.pressure_map import PressedSeal

RNG = np.random.default_rng(5)


def tiles(x1, x2, frame, place):
    """Quadrilaterals between lines."""
    corner = place(*np.meshgrid(x1, x2, indexing="ij"))
    parts = [corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]]
    return PressedSeal(frame, np.stack(parts, axis=2).reshape(-1, 4, 2))


def strip(size=(2e-3, 8e-3), cells=(4, 8)):
    """A strip of tiles."""
    lines = (np.linspace(0, side, n + 1) for side, n in zip(size, cells, strict=True))
    return tiles(*lines, Frame.for_strip(size), lambda x1, x2: np.stack([x1, x2], axis=-1))


def ring(inner=10e-3, outer=15e-3, cells=(6, 48), centre=(0.0, 0.0)):
    """A ring of quadrilaterals around a centre."""
    r, angle = np.linspace(inner, outer, cells[0] + 1), np.linspace(0, 2 * np.pi, cells[1] + 1)
    frame = Frame(centre=centre, ends=(inner, outer))
    return tiles(
        r, angle, frame, lambda r, a: np.stack([r * np.cos(a), r * np.sin(a)], axis=-1) + centre
    )


def fractions(pressure_map, seal, nominal=1e8):
    return seal.fractions(pressure_map, seal.centres, nominal)[0]


LINEAR = MapsAtLoads((1e8, 3e8), (Profile((1, 3)), Uniform()))


@pytest.mark.parametrize("seal", [strip(), ring()], ids=["strip", "ring"])
@pytest.mark.parametrize(
    "pressure_map",
    [
        Profile((0, 2, 5)),
        Profile((1, 3), (0, 0.1)),
        AngleTable((1, 0, 3), (0.1, 1, 2)),
        Uniform(),
        Profile((0.3, 0.3, 0.3)),
        Profile((0.7, 0.7), (0, 0.1)),
        AngleTable((0.1, 0.1)),
        LINEAR,
    ],
    ids=str,
)
def test_the_mean_over_the_area_is_one(seal, pressure_map):
    found = fractions(pressure_map, seal)
    assert_allclose(np.average(found, weights=seal.areas), 1.0, rtol=1e-12)
    if len(set(getattr(pressure_map, "fractions", (1.0,)))) == 1 and pressure_map is not LINEAR:
        assert_array_equal(found, 1.0)


def test_a_profile_goes_from_the_inlet_to_the_outlet():
    """In strips, or between radii or distances; at the edge of two strips it has the mean of both."""
    straight, around = strip(), ring()
    found = fractions(Profile((0, 2, 4, 2)), straight).reshape(4, 8)
    assert_allclose(found, np.repeat([[0], [1], [2], [1]], 8, axis=1))
    edges = np.array([[1e-3, 0], [0.5e-3, 0]])
    assert_allclose(straight.fractions(Profile((1, 3)), edges, 1.0)[0], [1.0, 0.5])
    outside = PressedSeal(Frame(ends=(15e-3, 10e-3)), around.outlines)
    assert_allclose(fractions(Profile((1, 2, 3)), around), fractions(Profile((3, 2, 1)), outside))
    r = np.hypot(*around.centres.T)
    linear = fractions(Profile((10, 15), (10e-3, 15e-3)), around)
    assert_allclose(linear, r / np.average(r, weights=around.areas))
    linear = fractions(Profile((0, 2), (0, 2e-3)), straight)
    assert_allclose(linear, straight.centres[:, 0] / 1e-3)


def test_a_table_of_angles_is_periodic_and_repeats():
    """The angle of a strip is its length; the centre does not matter."""
    seal = ring(cells=(2, 720))
    angle = np.degrees(np.arctan2(*seal.centres.T[::-1])) % 45
    values = np.interp(angle, [0, 22.5, 45], [2, 1, 2])  # under eight bolts
    for table in (AngleTable((2, 1), repeat=8), AngleTable((2, 1) * 8)):
        assert_allclose(fractions(table, seal), values / values.mean(), rtol=1e-9)
    uneven = AngleTable((2, 1), tuple(np.radians((5, 40))), repeat=8)
    assert_allclose(uneven.at(np.array([[1.0, 0.0]]), seal.frame), 1.5, rtol=1e-12)
    table = AngleTable((1, 2, 3, 2), tuple(np.radians((45, 135, 225, 315))))
    assert_allclose(fractions(table, strip(cells=(1, 4))), [0.5, 1, 1.5, 1])
    there = fractions(table, ring(centre=(0.02, -0.03), cells=(3, 24)))
    assert_allclose(there, fractions(table, ring(cells=(3, 24))), rtol=1e-9)


def test_maps_at_loads_are_linear_between_them():
    seal = strip()
    found = seal.fractions(LINEAR, seal.centres, [5e7, 1e8, 2e8, 3e8, 9e8])
    assert_allclose(found[:, 0], [0.5, 0.5, 0.75, 1, 1])


def test_a_linear_field_is_met_exactly_and_a_smooth_one_with_order_two():
    points = RNG.uniform(-1, 1, (300, 2)) * 0.02
    field = PressureField.from_points(points, 5 + points @ [100, 50])
    inside = RNG.uniform(-1, 1, (40, 2)) * 0.015
    assert_allclose(field.at(inside, Frame()), 5 + inside @ [100, 50], rtol=1e-9)
    errors = []
    for n in (8, 16, 32):
        points, centres = (ring(cells=c).outlines for c in ((n // 2, 4 * n), (5, 40)))
        points, centres = np.unique(points.reshape(-1, 2), axis=0), centres.mean(axis=1)
        given, exact = (2 + np.cos(2 * np.arctan2(x[:, 1], x[:, 0])) for x in (points, centres))
        errors.append(
            np.abs(PressureField.from_points(points, given).at(centres, Frame()) - exact).max()
        )
    assert min(np.log2(np.divide(errors[:-1], errors[1:]))) > 1.6


@pytest.mark.parametrize(
    ("cells", "seal", "message"),
    [
        (
            (4, 48),
            ring(5e-3, 15e-3),
            r"given x -0.015 to 0.015 m.* expected a pressure field that covers the s",
        ),
        ((4, 48), ring(10e-3, 16e-3), "expected a pressure field that covers the seal"),
        ((12, 600), ring(9e-3, 14e-3, (100, 400)), "without points of the seal such as"),
        ((4, 24), ring(cells=(40, 480)), None),  # chords cover the arcs that they cut
    ],
)
def test_the_hole_of_a_ring_and_the_outside_are_not_covered(cells, seal, message):
    points = ring(cells=cells).outlines.reshape(-1, 2)
    field = PressureField.from_points(points, np.ones(len(points)))
    if message:
        with pytest.raises(InputError, match=message):
            field.at(seal.centres, Frame())
    else:
        assert_allclose(field.at(seal.centres, Frame()), 1.0)


def test_long_triangles_far_from_their_middles_are_found():
    """Many small triangles beside a few long ones."""
    fine = RNG.uniform(0, 1, (2000, 2)) * [0.1, 1]
    points = np.vstack([fine, [[0.1, 0], [0.1, 1], [10, 0], [10, 1]]])
    long = [[2000, 2001, 2003], [2000, 2003, 2002]]
    triangles = np.vstack([PressureField.from_points(fine, np.ones(len(fine))).triangles, long])
    patches = np.stack([np.linspace(0.2, 9.9, 50), np.full(50, 0.5)], axis=1)
    field = PressureField.from_points(points, points[:, 0], triangles)
    assert_allclose(field.at(patches, Frame()), patches[:, 0])


@pytest.mark.parametrize(
    ("points", "pressure", "text"),
    [
        (np.eye(3)[:, :2], [np.nan, 1, 1], "pressure: given 1 of 3 values not finite"),
        (np.eye(3)[:, :2], [-1e6, 1, 1], "negative, the least -1 MPa"),
        ([[0, 0], [1, 1], [2, 2]], np.ones(3), "on a line"),
        (np.full((4, 2), np.inf), np.ones(4), "points not finite"),
        ([[-1, -1], [3, -1], [-1, 3]], np.zeros(3), "0 all over the seal"),
    ],
)
def test_bad_fields(points, pressure, text):
    with pytest.raises(InputError, match=text):
        fractions(PressureField.from_points(points, pressure), strip())


UNITS = {"length_unit": "mm", "pressure_unit": "MPa"}


def linear(x):
    """A pressure over x [m] that is linear in it [Pa]."""
    return 1e6 * (10 + 1e3 * x @ [1, 2])


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "  "])
def test_columns(tmp_path, delimiter):
    path = tmp_path / "flange.csv"
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 2, 9), np.linspace(0, 8, 17)))
    table = np.stack([10 + x + 2 * y, 0 * x, x, y], axis=1)
    head = delimiter.join(("CPRESS", "z", "x", "y"))
    np.savetxt(path, table, delimiter=delimiter, header=f"# a comment\n{head}", comments="")
    field = read_pressure_field(path, name="CPRESS", **UNITS)
    centres = strip().centres
    assert_allclose(field.at(centres, Frame()), linear(centres))


@pytest.mark.parametrize(
    ("kind", "mesh"),
    [("triangle", MeshTri), ("quad", MeshQuad), ("quad9", MeshQuad2), ("triangle6", MeshTri2)],
)
@pytest.mark.parametrize("of", ["points", "cells"])
def test_meshes(tmp_path, kind, mesh, of):
    base = MeshTri if kind.startswith("tri") else MeshQuad
    made = base.init_tensor(np.linspace(0, 2, 9), np.linspace(0, 8, 17))
    points, cells = made.p.T, made.t.T
    if mesh is not base:
        made = mesh.from_mesh(made)
        points, cells = made.doflocs.T, made.dofs.element_dofs.T
    data = {"point_data": {"p": 10 + points @ [1, 2]}}
    if of == "cells":
        data = {"cell_data": {"p": [10 + points[cells].mean(axis=1) @ [1, 2]]}}
    path = tmp_path / "flange.vtu"
    meshio.Mesh(np.pad(points, ((0, 0), (0, 1))), [(kind, cells)], **data).write(path)
    centres = strip(cells=(3, 5)).centres
    found = read_pressure_field(path, name="p", **UNITS).at(centres, Frame())
    tolerance = {"rtol": 1e-9} if of == "points" else {"atol": 0.7e6}  # within half a cell
    assert_allclose(found, linear(centres), **tolerance)


POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
TRIANGLE = [("triangle", [[0, 1, 2]])]


@pytest.mark.parametrize(
    ("file", "more", "message"),
    [
        ("", {}, "which is empty"),
        ("x,y\n0,0\n", {}, "with the columns x, y, expected one column each of x, y, pressure"),
        ("x,y,pressure,x\n0,0,1,0\n", {}, "named in the first line: x"),
        ("x;y;pressure\n0;0;1,5\n", {}, "with the line '0;0;1,5', expected numbers with decimal"),
        ("x,y,pressure\n0,0\n", {}, "with the line '0,0'"),
        ("x,y,pressure\n0,0,nan\n1,0,1\n0,1,1\n", {}, "1 of 3 values not finite"),
        ("x,y,pressure\n0,0,1\n1,0,1\n0,1,-1\n", {}, "1 of 3 values not finite or negative"),
        ("x,y,pressure\n0,0,1\n", {}, "at least three points"),
        ("x,y,pressure\n0,0,1\n", {"length_unit": "MPa"}, "length_unit"),
        (None, {}, "an existing file"),
        (meshio.Mesh(POINTS, TRIANGLE, {"p": np.ones((3, 3))}), {}, "name: given 'pressure'.*'p'"),
        (
            meshio.Mesh(POINTS, TRIANGLE, {"p": np.ones((3, 3))}),
            {"name": "p"},
            "one number for eac",
        ),
        (meshio.Mesh(POINTS + np.diag([0, 0, 1]), TRIANGLE), {}, "varying z"),
        (meshio.Mesh(POINTS, [("line", [[0, 1]])]), {}, "with line, expected a mesh with cells of"),
    ],
)
def test_bad_files(tmp_path, file, more, message):
    path = tmp_path / ("bad.vtu" if isinstance(file, meshio.Mesh) else "bad.csv")
    if isinstance(file, str):
        path.write_text(file)
    elif file:
        file.write(path)
    with pytest.raises(InputError, match=message):
        read_pressure_field(path, **UNITS | more)


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        (Profile, ((),), "fractions"),
        (Profile, ((0.0, 0.0),), "not all of them 0"),
        (Profile, ((1.0, -1.0),), "fractions: given -1.0"),
        (Profile, (3.0,), "a list of numbers"),
        (Profile, ((1.0, 2.0), (0.0,)), "positions: given 1 number, expected 2"),
        (Profile, ((1.0, 2.0), (1.0, 0.0)), "rising numbers"),
        (Profile, ((1, 2), (0, 1e-3)), "positions: given 0 m to 1 mm, expected .* tiles"),
        (AngleTable, ((1.0, 2.0), (0.0, 2 * np.pi)), "less than one period, 360°"),
        (AngleTable, ((1.0, 2.0), (0.0, 1.0), 8), "less than one period, 45°"),
        (AngleTable, ((1.0, 2.0), None, 0), "repeat"),
        (MapsAtLoads, ((), ()), "maps: given none"),
        (MapsAtLoads, ((1.0,), (Uniform(), Uniform())), "2, one for each map"),
        (MapsAtLoads, ((2.0, 1.0), (Uniform(), Uniform())), "rising"),
    ],
)
def test_what_is_refused(kind, given, message):
    with pytest.raises(InputError, match=message):
        fractions(kind(*given), strip())


def test_a_profile_is_none_on_a_mesh():
    with pytest.raises(InputError, match="none on a mesh"):
        fractions(Profile((1, 2)), PressedSeal(Frame(), ring().outlines))
