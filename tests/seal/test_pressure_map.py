"""Maps of contact pressure: their shapes, their mean, fields from files, and what they refuse."""

import meshio
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from femseal import InputError
from femseal.seal.pressure_map import (
    AngleTable,
    Frame,
    MapsAtLoads,
    PressedSeal,
    PressureField,
    Profile,
    Uniform,
)
from femseal.seal.seal_files import read_pressure_field
from femseal.seal.triangulation import Triangulation

RNG = np.random.default_rng(5)


def strip(size=(2e-3, 8e-3), cells=(4, 8)):
    """A strip of tiles."""
    x1, x2 = (np.linspace(0, side, n + 1) for side, n in zip(size, cells, strict=True))
    corner = np.stack(np.meshgrid(x1, x2, indexing="ij"), axis=-1)
    outlines = np.stack(
        [corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=2
    )
    return PressedSeal(Frame.of_strip(size), outlines.reshape(-1, 4, 2))


def ring(inner=10e-3, outer=15e-3, cells=(6, 48), centre=(0.0, 0.0)):
    """A ring of quadrilaterals around a centre."""
    r, angle = np.linspace(inner, outer, cells[0] + 1), np.linspace(0, 2 * np.pi, cells[1] + 1)
    corner = r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1) + centre
    outlines = np.stack(
        [corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]], axis=2
    )
    return PressedSeal(Frame(centre=centre, ends=(inner, outer)), outlines.reshape(-1, 4, 2))


def fractions(pressure_map, seal, nominal=1e8):
    return seal.fractions(pressure_map, seal.centres, nominal)[0]


class TestShapes:
    def test_uniform_maps_are_exactly_one(self):
        equal = (
            Uniform(),
            Profile((0.3, 0.3, 0.3)),
            Profile((0.7, 0.7), (0, 0.1)),
            AngleTable((0.1, 0.1)),
        )
        for seal in (strip(), ring()):
            for pressure_map in equal:
                assert_array_equal(fractions(pressure_map, seal), 1.0)

    @pytest.mark.parametrize(
        "pressure_map",
        [Profile((0, 2, 5)), Profile((1, 3), (0, 0.1)), AngleTable((1, 0, 3), (0.1, 1, 2))],
        ids=str,
    )
    @pytest.mark.parametrize("seal", [strip(), ring()], ids=["strip", "ring"])
    def test_the_mean_over_the_area_is_one(self, seal, pressure_map):
        assert_allclose(
            np.average(fractions(pressure_map, seal), weights=seal.areas), 1.0, rtol=1e-12
        )

    def test_shares_of_a_profile_are_strips_from_the_inlet(self):
        assert_allclose(
            fractions(Profile((0, 2, 4, 2)), strip()).reshape(4, 8),
            np.repeat([[0], [1], [2], [1]], 8, axis=1),
        )
        # three strips on four rows, and at the edges between them the mean of both
        seal, edges = strip(), np.array([[1e-3, 0], [0.5e-3, 0]])
        assert_allclose(seal.fractions(Profile((1, 3)), edges, 1.0)[0], [1.0, 0.5])

    def test_a_ring_whose_inlet_is_outside_begins_there(self):
        seal = ring()
        turned = PressedSeal(Frame(ends=(15e-3, 10e-3)), seal.outlines)
        assert_allclose(fractions(Profile((1, 2, 3)), seal), fractions(Profile((3, 2, 1)), turned))

    def test_positions_of_a_profile_are_radii_or_distances(self):
        seal = ring()
        r = np.hypot(*seal.centres.T)
        linear = fractions(Profile((10, 15), (10e-3, 15e-3)), seal)
        assert_allclose(linear, r / np.average(r, weights=seal.areas))
        straight = strip()
        assert_allclose(
            fractions(Profile((0, 2), (0, 2e-3)), straight), straight.centres[:, 0] / 1e-3
        )

    def test_a_table_of_angles_is_periodic_and_repeats(self):
        seal = ring(cells=(2, 720))
        angle = np.degrees(np.arctan2(*seal.centres.T[::-1])) % 45
        values = np.interp(angle, [0, 22.5, 45], [2, 1, 2])  # under eight bolts
        assert_allclose(
            fractions(AngleTable((2, 1), repeat=8), seal), values / values.mean(), rtol=1e-9
        )
        whole = AngleTable((2, 1) * 8)
        assert_allclose(fractions(whole, seal), values / values.mean(), rtol=1e-9)
        uneven = AngleTable((2, 1), tuple(np.radians((5, 40))), repeat=8)
        assert_allclose(uneven.at(np.array([[1.0, 0.0]]), seal.frame), 1.5, rtol=1e-12)

    def test_an_angle_on_a_strip_is_its_length(self):
        seal = strip(cells=(1, 4))
        assert_allclose(
            fractions(AngleTable((1, 2, 3, 2), tuple(np.radians((45, 135, 225, 315)))), seal),
            [0.5, 1, 1.5, 1],
        )

    def test_shares_do_not_depend_on_the_centre(self):
        table = AngleTable((1, 2, 4))
        there, here = (ring(centre=c, cells=(3, 24)) for c in ((0.02, -0.03), (0.0, 0.0)))
        assert_allclose(fractions(table, there), fractions(table, here), rtol=1e-9)

    def test_maps_at_loads_are_linear_between_them(self):
        seal = strip()
        series = MapsAtLoads((1e8, 3e8), (Profile((1, 3)), Uniform()))
        found = seal.fractions(series, seal.centres, [5e7, 1e8, 2e8, 3e8, 9e8])
        assert_allclose(found[:, 0], [0.5, 0.5, 0.75, 1, 1])
        assert_allclose(found.mean(axis=1), 1.0)
        single = MapsAtLoads((1e8,), (Profile((1, 3)),))
        assert_allclose(
            seal.fractions(single, seal.centres, [5e7, 9e8]),
            np.tile(fractions(Profile((1, 3)), seal), (2, 1)),
        )


class TestFields:
    def test_a_linear_field_is_met_exactly(self):
        points = RNG.uniform(-1, 1, (300, 2)) * 0.02
        field = PressureField.of(points, 5 + 100 * points[:, 0] + 50 * points[:, 1])
        inside = RNG.uniform(-1, 1, (40, 2)) * 0.015
        assert_allclose(field.at(inside, Frame()), 5 + inside @ [100, 50], rtol=1e-9)

    def test_the_order_of_a_smooth_field_is_two(self):
        errors = []
        for n in (8, 16, 32):
            r, angle = np.linspace(10e-3, 15e-3, n // 2 + 1), np.arange(4 * n) * (np.pi / (2 * n))
            points = (r[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)).reshape(
                -1, 2
            )
            field = PressureField.of(points, 2 + np.cos(2 * np.arctan2(points[:, 1], points[:, 0])))
            centres = ring(cells=(5, 40)).centres
            exact = 2 + np.cos(2 * np.arctan2(centres[:, 1], centres[:, 0]))
            errors.append(np.abs(field.at(centres, Frame()) - exact).max())
        assert min(np.log2(np.divide(errors[:-1], errors[1:]))) > 1.6

    def test_the_hole_of_a_ring_and_the_outside_are_not_covered(self):
        points = ring(cells=(4, 48)).outlines.reshape(-1, 2)
        field = PressureField.of(points, np.ones(len(points)))
        for inner, outer in ((5e-3, 15e-3), (10e-3, 16e-3)):
            with pytest.raises(
                InputError,
                match=r"field: given x -0.015 to 0.015 m.* expected one that covers the seal",
            ):
                field.at(ring(inner, outer).centres, Frame())

    def test_chords_cover_the_arcs_that_they_cut(self):
        """Tiles at the rim of a ring lie outside the polygon of a coarse field."""
        seal = ring(cells=(40, 480))
        coarse = ring(cells=(4, 24)).outlines.reshape(-1, 2)
        assert_allclose(
            PressureField.of(coarse, np.ones(len(coarse))).at(seal.centres, Frame()), 1.0
        )

    def test_fine_fields_that_do_not_cover_are_refused(self):
        points = ring(cells=(12, 600)).outlines.reshape(-1, 2)
        field = PressureField.of(points, np.ones(len(points)))
        with pytest.raises(InputError, match="without places on the seal such as"):
            field.at(ring(9e-3, 14e-3, cells=(100, 400)).centres, Frame())

    def test_long_triangles_far_from_their_middles_are_found(self):
        """Many small triangles beside a few long ones."""
        fine = RNG.uniform(0, 1, (2000, 2)) * [0.1, 1]
        points = np.vstack([fine, [[0.1, 0], [0.1, 1], [10, 0], [10, 1]]])
        triangles = np.vstack(
            [Triangulation.of(fine).triangles, [[2000, 2001, 2003], [2000, 2003, 2002]]]
        )
        places = np.stack([np.linspace(0.2, 9.9, 50), np.full(50, 0.5)], axis=1)
        assert_allclose(
            PressureField.of(points, points[:, 0], triangles).at(places, Frame()), places[:, 0]
        )

    def test_bad_numbers(self):
        points = RNG.uniform(0, 1, (20, 2))
        for bad, text in (
            (np.nan, "pressure: given 1 of 20 values not finite"),
            (-1e6, "negative, the least -1 MPa"),
        ):
            with pytest.raises(InputError, match=text):
                PressureField.of(points, np.r_[bad, np.ones(19)])
        with pytest.raises(InputError, match="on a line"):
            PressureField.of([[0, 0], [1, 1], [2, 2]], np.ones(3))
        with pytest.raises(InputError, match="points not finite"):
            PressureField.of(np.full((4, 2), np.inf), np.ones(4))
        with pytest.raises(InputError, match="0 all over the seal"):
            fractions(PressureField.of([[-1, -1], [3, -1], [-1, 3]], np.zeros(3)), strip())


class TestFiles:
    @pytest.fixture
    def values(self):
        x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 2, 9), np.linspace(0, 8, 17)))
        return x, y, 10 + x + 2 * y

    @pytest.mark.parametrize("delimiter", [",", ";", "\t", "  "])
    def test_columns(self, tmp_path, values, delimiter):
        path = tmp_path / "flange.csv"
        rows = (
            delimiter.join((str(p), "0", str(x), str(y))) for x, y, p in zip(*values, strict=True)
        )
        path.write_text(
            "# a comment\n" + "\n".join([delimiter.join(("CPRESS", "z", "x", "y")), *rows]) + "\n"
        )
        field = read_pressure_field(path, length_unit="mm", pressure_unit="MPa", name="CPRESS")
        centres = strip().centres
        assert_allclose(field.at(centres, Frame()), 1e6 * (10 + 1e3 * centres @ [1, 2]))

    @pytest.mark.parametrize("kind", ["triangle", "quad", "quad9", "triangle6"])
    @pytest.mark.parametrize("of", ["points", "cells"])
    def test_meshes(self, tmp_path, kind, of):
        from skfem import MeshQuad, MeshQuad2, MeshTri, MeshTri2

        made = {"triangle": MeshTri, "quad": MeshQuad, "quad9": MeshQuad2, "triangle6": MeshTri2}[
            kind
        ]
        base = MeshTri if kind.startswith("tri") else MeshQuad
        mesh = base.init_tensor(np.linspace(0, 2, 9), np.linspace(0, 8, 17))
        mesh = made.from_mesh(mesh) if kind[-1] in "69" else mesh
        points, cells = mesh.doflocs.T, mesh.dofs.element_dofs.T if kind[-1] in "69" else mesh.t.T
        middles = points[cells].mean(axis=1)
        data = (
            {"point_data": {"p": 10 + points @ [1, 2]}}
            if of == "points"
            else {"cell_data": {"p": [10 + middles @ [1, 2]]}}
        )
        path = tmp_path / "flange.vtu"
        meshio.Mesh(np.pad(points, ((0, 0), (0, 1))), [(kind, cells)], **data).write(path)
        field = read_pressure_field(path, length_unit="mm", pressure_unit="MPa", name="p")
        centres = strip(cells=(3, 5)).centres
        tolerance = {"rtol": 1e-9} if of == "points" else {"atol": 0.7e6}  # within half a cell
        assert_allclose(
            field.at(centres, Frame()), 1e6 * (10 + 1e3 * centres @ [1, 2]), **tolerance
        )

    @pytest.mark.parametrize(
        ("text", "message"),
        [
            ("", "which is empty"),
            ("x,y\n0,0\n", "with the columns x, y, expected one column each of x, y, pressure"),
            ("x,y,pressure,x\n0,0,1,0\n", "named in the first line: x"),
            (
                "x;y;pressure\n0;0;1,5\n",
                "with the line '0;0;1,5', expected numbers with decimal points",
            ),
            ("x,y,pressure\n0,0\n", "with the line '0,0'"),
            ("x,y,pressure\n0,0,nan\n1,0,1\n0,1,1\n", "1 of 3 values not finite"),
            ("x,y,pressure\n0,0,1\n1,0,1\n0,1,-1\n", "1 of 3 values negative"),
            ("x,y,pressure\n0,0,1\n", "at least three points"),
        ],
    )
    def test_bad_texts(self, tmp_path, text, message):
        path = tmp_path / "bad.csv"
        path.write_text(text)
        with pytest.raises(InputError, match=message):
            read_pressure_field(path, length_unit="mm", pressure_unit="MPa")

    def test_bad_meshes(self, tmp_path):
        path = tmp_path / "bad.vtu"
        units = {"length_unit": "mm", "pressure_unit": "MPa"}
        with pytest.raises(InputError, match="an existing file"):
            read_pressure_field(path, **units)
        path.write_text("nothing")
        with pytest.raises(InputError, match="in a format that meshio reads"):
            read_pressure_field(path, **units)
        points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
        meshio.Mesh(points, [("triangle", [[0, 1, 2]])], {"p": np.ones((3, 3))}).write(path)
        with pytest.raises(InputError, match=r"name: given 'pressure'.*'p'"):
            read_pressure_field(path, **units)
        with pytest.raises(InputError, match="one number for each point or cell"):
            read_pressure_field(path, name="p", **units)
        meshio.Mesh(points + np.diag([0, 0, 1]), [("triangle", [[0, 1, 2]])]).write(path)
        with pytest.raises(InputError, match="varying z"):
            read_pressure_field(path, **units)
        meshio.Mesh(points, [("line", [[0, 1]])]).write(path)
        with pytest.raises(InputError, match="with line, expected a mesh with cells of triangle"):
            read_pressure_field(path, **units)
        with pytest.raises(InputError, match="length_unit"):
            read_pressure_field(path, length_unit="MPa", pressure_unit="MPa")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Profile(()), "fractions"),
        (lambda: Profile((0.0, 0.0)), "not all of them 0"),
        (lambda: Profile((1.0, -1.0)), "fractions: given -1.0"),
        (lambda: Profile((1.0, np.nan)), "fractions: given nan"),
        (lambda: Profile(3.0), "a list of numbers"),
        (lambda: Profile((1.0, 2.0), (0.0,)), "positions: given 1 number, expected 2"),
        (lambda: Profile((1.0, 2.0), (1.0, 0.0)), "rising numbers"),
        (lambda: AngleTable((1.0, 2.0), (0.0, 2 * np.pi)), "below one period, 360°"),
        (lambda: AngleTable((1.0, 2.0), (0.0, 1.0), 8), "below one period, 45°"),
        (lambda: AngleTable((1.0, 2.0), repeat=0), "repeat"),
        (lambda: MapsAtLoads((), ()), "maps: given none"),
        (lambda: MapsAtLoads((1.0,), (Uniform(), Uniform())), "2, one for each map"),
        (lambda: MapsAtLoads((2.0, 1.0), (Uniform(), Uniform())), "rising"),
        (
            lambda: fractions(Profile((1, 2), (0, 1e-3)), strip()),
            "positions: given 0 m to 1 mm, expected .* tiles",
        ),
        (
            lambda: fractions(Profile((1, 2)), PressedSeal(Frame(), ring().outlines)),
            "none on a mesh",
        ),
    ],
)
def test_what_is_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
