"""Texts as instruments and spreadsheets export them: encodings, headers, quotes, undefined points, coordinates."""

import logging
import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.base import InputError
from femseal.topography import read_for_a_look, read_topography
from femseal.topography.coordinates import find_lattice

#: Heights (y, x) in micrometres, as lines of a text, and their pixel [m].
LINES = np.round(np.random.default_rng(0).standard_normal((12, 15)), 3)
HEIGHTS = 1e-6 * LINES.T
PIXEL = (2e-6, 2e-6)
MICRONS = {"spacing": PIXEL, "height_unit": "um"}


def matrix(delimiter="\t", quote="", lines=LINES):
    """Lines of a matrix as text."""
    return "".join(delimiter.join(f"{quote}{v:.3f}{quote}" for v in line) + "\n" for line in lines)


def look(folder, text, name="face.txt", **said):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_for_a_look(path, **said)


def same(found, heights=HEIGHTS, pixel=PIXEL):
    assert not found.errors
    assert_allclose(found.topography.heights, heights, atol=1e-15)
    assert_allclose(found.topography.spacing, pixel)


def refused(folder, text, match, **said):
    with pytest.raises(InputError, match=match) as error:
        look(folder, text, **said)
    assert "\n" not in str(error.value)


def without(*points):
    """The heights without some points (x, y)."""
    heights = HEIGHTS.copy()
    for point in points:
        heights[point] = np.nan
    return heights


# --- encodings, quotes, commas ----------------------------------------------------------------------------

HEAD = "# Width: 30 µm\n# Height: 24 µm\n# Value units: µm\n"


@pytest.mark.parametrize(
    "encoding", ["utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le", "utf-16-be"]
)
def test_texts_in_all_usual_encodings_are_read(tmp_path, encoding):
    same(look(tmp_path, (HEAD + matrix()).encode(encoding)))


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", ", "])
def test_quoted_numbers_are_read(tmp_path, delimiter):
    same(look(tmp_path, matrix(delimiter, '"'), **MICRONS))


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " "])
def test_quoted_decimal_commas_are_read(tmp_path, delimiter):
    same(look(tmp_path, matrix(delimiter, '"').replace(".", "\0").replace("\0", ","), **MICRONS))


@pytest.mark.parametrize(
    "word",
    [
        "NA",
        "n/a",
        "No Data",
        "BAD",
        "***",
        "--",
        "#N/A",
        "#NUM!",
        "NaN",
        "-1.#IND",
        "",
        " ",
        "null",
    ],
)
@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_words_for_an_undefined_point_are_recognised(tmp_path, word, delimiter):
    first, later = (f"{LINES[j, i]:.3f}" for i, j in ((0, 0), (4, 7)))
    text = matrix(delimiter).replace(first, word, 1).replace(later, word, 1)
    same(look(tmp_path, text, **MICRONS), without((0, 0), (4, 7)))


def test_words_for_undefined_points_between_blanks_are_recognised(tmp_path):
    text = matrix(" ").replace(f"{LINES[7, 4]:.3f}", "No Data")
    same(look(tmp_path, text, **MICRONS), without((4, 7)))


# --- headers ----------------------------------------------------------------------------------------------

KEYENCE = """"Measured date","2024-05-01"
"Model","VK-X3000 Series"
"Data type
","ImageDataCsv"
"XY Calibration","2.000","um"
"Output image data","Height"
"Horizontal","15"
"Vertical","12"
"Minimum value","-2.5"
"Unit","µm"
"Reference data name",""

"Height"
"""
SPIP = """# File Format = ASCII
# x-pixels = 15
# y-pixels = 12
# x-length = 30000 (nm)
# y-length = 24000 (nm)
# Bit2nm = 1000.0
# Start of Data:
"""
NOVA = """File Format = ASCII
NX = 15
NY = 12
Scale X = 2
Scale Y = 2
Unit X = µm
Unit Data = µm
Start of Data :
"""


@pytest.mark.parametrize(
    ("head", "delimiter"),
    [
        (HEAD, "\t"),
        (HEAD.replace("Width", "Breite").replace("Height", "Höhe").replace("Value u", "U"), "\t"),
        (SPIP, "\t"),
        (NOVA, "\t"),
        ("Pixel size: 2 microns/pixel\nUnits: [um]\n15 12\n", " "),
        (HEAD.replace("#", "%"), ";"),
        (HEAD.replace("#", "//"), ","),
    ],
)
def test_pixel_size_and_unit_are_read_from_headers(tmp_path, head, delimiter):
    same(look(tmp_path, head + matrix(delimiter)))


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_an_export_of_keyence_is_read(tmp_path, encoding):
    same(look(tmp_path, (KEYENCE + matrix(",", '"')).encode(encoding)))


def test_a_german_export_of_keyence_is_read(tmp_path):
    names = {"XY Calibration": "XY-Justierung", "Unit": "Einheit", "Horizontal": "Horizont."}
    text = KEYENCE + matrix(";", '"')
    for english, german in names.items():
        text = text.replace(english, german)
    same(look(tmp_path, text.replace('","', '";"').replace(".0", ",0").replace(".", ",")))


def zygo(resolution):
    head = 'Zygo XYZ Data File - Format 1\n0 3 0 0 "Tue"\n0 0 15 12 1 255\n0 0 15 12\n"a"\n""\n""\n'
    head += f'0 0 6.328e-07 0.5 1 0 {resolution} 17\n3 2 0 0 0 6666 "x"\n0 1 2 3\n1 2\n0\n0\n#\n'
    lines = [
        f"{i} {j} {LINES[j, i]:.3f}" if (i, j) != (3, 4) else f"{i} {j} No Data"
        for j in range(12)
        for i in range(15)
    ]
    return head + "\n".join(lines) + "\n#\n"


def test_an_export_of_zygo_is_read(tmp_path):
    """Coordinates count pixels, whose size the head says unless the camera was not calibrated; heights are in µm."""
    same(look(tmp_path, zygo("2e-06"), "face.xyz"), without((3, 4)))
    open_pixel = look(tmp_path, zygo("0"), "face.xyz")
    assert "no pixel size in the file" in str(open_pixel.errors[0])
    same(look(tmp_path, zygo("0"), "face.xyz", spacing=PIXEL), without((3, 4)))
    refused(tmp_path, "Zygo ASCII Data File - Format 2\n" + matrix(), "a Zygo ASCII file")


def test_an_export_of_wyko_is_read(tmp_path):
    """A line of it runs along y; blocks have names and types."""
    pytest.importorskip("SurfaceTopography")
    head = "Wyko ASCII Data File Format 0\t1\t1\nX Size\t15\nY Size\t12\nBlock Name\tType\tLength\tValue\n"
    head += "Pixel_size\t7\t4\t0.002\nWavelength\t7\t4\t632.8\nMult\t7\t4\t2\nRAW_DATA\t3\t48\t\n"
    text = head + matrix(lines=1e3 * LINES.T).replace(f"{1e3 * LINES[4, 3]:.3f}", "Bad")
    found = look(tmp_path, text, "face.asc").topography
    assert_allclose(found.spacing, PIXEL)
    assert np.isnan(found.heights).sum() == 1
    assert_allclose(np.nanstd(found.heights), np.nanstd(without((3, 4))), rtol=1e-6)


ESRI = "ncols 15\nnrows 12\nxllcorner 0\nyllcorner 0\ncellsize 2\nNODATA_value -9999\n"


@pytest.mark.parametrize("mark", ["", "# "])
def test_an_esri_raster_with_undefined_points_is_read(tmp_path, mark):
    """The value of its header is undefined, behind a comment mark too; the cell has no unit, which is asked for."""
    head = "".join(f"{mark}{line}\n" for line in ESRI.splitlines())
    text = head + matrix(" ").replace(f"{LINES[7, 4]:.3f}", "-9999")
    found = look(tmp_path, text, **MICRONS)
    same(found, without((4, 7)))
    assert "1 point (0.556 %) at -9999: undefined, as the file says" in found.notes
    error = str(look(tmp_path, text, height_unit="um").errors[0])
    assert "no pixel size in the file (15 × 12 points; it says 'cellsize 2')" in error
    # lines may be broken anywhere where the header says the points
    whole = text[len(head) :].split()
    broken = "\n".join(" ".join(whole[n : n + 7]) for n in range(0, len(whole), 7))
    same(look(tmp_path, head + broken, **MICRONS), without((4, 7)))
    refused(tmp_path, head + broken[:-20], r"given 2 numbers in line 32 after 7 in line 7")
    lines = text.splitlines()
    said = "given 15 × 11 numbers, where its header says 15 × 12"
    refused(tmp_path, "\n".join(lines[:-1]), said)


def test_units_of_the_caller_replace_those_that_cannot_be_read(tmp_path):
    text = HEAD.replace("units: µm", "units: V").replace("30 µm", "9 apples") + matrix()
    first, second = look(tmp_path, text).errors
    assert "no pixel size in the file (15 × 12 points; it says " in str(first)
    assert "'Width: 9 apples'" in str(first)
    assert "no unit of height in the file that can be read" in str(second)
    assert "'Value units: V'" in str(second)
    found = look(tmp_path, text, **MICRONS)
    same(found)
    assert "height_unit um is used; the file has the " in found.notes[0]
    other = look(tmp_path, HEAD + matrix(), height_unit="nm", size=(15e-6, 24e-6))
    same(other, 1e-3 * HEIGHTS, (1e-6, 2e-6))
    assert other.notes == (
        "height_unit nm overrides the file, which says 1 µm per number",
        "size overrides the file, which says a pixel of 2 µm × 2 µm: it is 1 µm × 2 µm",
    )


@pytest.mark.parametrize(
    "text",
    [
        matrix().replace(f"{LINES[0, 2]:.3f}", "over"),
        "a header\n" + matrix().replace(f"{LINES[0, 2]:.3f}", "over"),
        matrix().replace(f"{LINES[9, 2]:.3f}", "over"),
    ],
)
def test_a_row_with_an_unknown_word_is_not_taken_for_a_header(tmp_path, text):
    refused(tmp_path, text, r"given 'over' in line \d+, .* put # before other lines")


def test_rows_with_missing_numbers_are_not_taken_for_a_header(tmp_path):
    lines = matrix().splitlines(keepends=True)
    cut = lines[0].rsplit("\t", 3)[0] + "\n"
    refused(tmp_path, cut + "".join(lines[1:]), "given 15 numbers in line 2 after 12 in line 1")


def test_a_file_with_two_maps_is_refused(tmp_path):
    refused(tmp_path, 2 * (HEAD + matrix()), "a second map, which begins in line 16")


def test_axes_in_the_first_line_and_column_are_removed(tmp_path):
    """A column of counts, as Olympus exports it, and a line of patches are no heights."""
    lines = [f"{n}\t{line}" for n, line in enumerate(matrix().splitlines())]
    names = "DataLine\t" + "\t".join(f"POS = {n}" for n in range(15))
    found = look(tmp_path, "\n".join([names, *lines]), **MICRONS)
    same(found)
    assert "the first column counts in even steps" in found.notes[0]
    patches = "mm\t" + "\t".join(f"{0.002 * n:.3f}" for n in range(15))
    same(look(tmp_path, "\n".join([patches, *lines]), **MICRONS))
    patches = patches.replace("mm", "0")
    same(look(tmp_path, "\n".join([patches, *lines]), **MICRONS))
    # a plane has even steps everywhere
    plane = np.add.outer(np.arange(12.0), 2 * np.arange(15.0))
    assert look(tmp_path, matrix(lines=plane), **MICRONS).topography.shape == (15, 12)


# --- coordinates ------------------------------------------------------------------------------------------


def table(step=2.0, missing=(), index=False, order=None, form="{:.3f} {:.3f} {:.3f}"):
    """Lines x y z of the heights, without some points (x, y)."""
    points = [(i, j) for j in range(12) for i in range(15) if (i, j) not in missing]
    if order is not None:
        points = [points[n] for n in order.permutation(len(points))]
    lines = [form.format(step * i, step * j, LINES[j, i]) for i, j in points]
    return "\n".join(f"{n} {line}" if index else line for n, line in enumerate(lines))


MISSING = ((0, 0), (4, 7), (14, 11), *((9, j) for j in range(12)))


@pytest.mark.parametrize("index", [False, True])
@pytest.mark.parametrize("shuffled", [False, True])
def test_grid_points_that_are_missing_in_a_table_are_undefined(tmp_path, index, shuffled):
    order = np.random.default_rng(1) if shuffled else None
    text = table(missing=MISSING, index=index, order=order)
    found = look(tmp_path, text, "face.xyz", **MICRONS)
    same(found, without(*MISSING))
    note = "the table x y z is a grid of 15 × 12 points; 15 points (8.33 %) are missing in it"
    assert note in found.notes[0]


def test_a_small_grid_with_few_points_is_recognised(tmp_path):
    lines = [f"{2 * i} {2 * j} {i * j}" for i in range(5) for j in range(4) if (i, j) != (2, 1)]
    found = look(tmp_path, "\n".join(lines), **MICRONS)
    heights = 1e-6 * np.outer(np.arange(5), np.arange(4))
    heights[2, 1] = np.nan
    same(found, heights)
    # a small matrix of three columns is none
    assert look(tmp_path, "1 2 3\n4 5 6\n7 8 9\n", **MICRONS).topography.shape == (3, 3)


@pytest.mark.parametrize("step", [1.38, 1 / 3, 0.0138])
def test_rounded_coordinates_form_a_grid(tmp_path, step):
    text = table(step, MISSING[:3], form="{:.3f} {:.3f} {:.3f}")
    found = look(tmp_path, text, size=(30e-6, 24e-6), height_unit="um")
    same(found, without(*MISSING[:3]))


def test_units_and_order_of_columns_follow_from_their_names(tmp_path):
    text = "Y [mm];X [mm];Z [µm];I\n" + table(
        0.002, form="{1:.3f};{0:.3f};{2:.3f};7", missing=MISSING
    )
    found = look(tmp_path, text.replace(".", ","))
    same(found, without(*MISSING))
    assert "4 in all" in found.notes[1]
    names = "index,x (um),y (um),z (nm)\n" + table(index=True).replace(" ", ",")
    same(look(tmp_path, names), 1e-3 * HEIGHTS)


def test_coordinates_without_a_unit_need_that_of_the_caller(tmp_path):
    """Metres, unless heights have another unit: then that of the coordinates is asked for."""
    same(look(tmp_path, table(2e-6, form="{:.7f} {:.7f} {:.3e}").replace("e+00", "e-06").replace(
        "e-01", "e-07").replace("e-02", "e-08").replace("e-03", "e-09")))  # fmt: skip
    error = str(look(tmp_path, table(), height_unit="um").errors[0])
    assert "it says 'coordinates in steps of 2 and 2, without a unit" in error


def test_an_array_of_coordinates_is_read(tmp_path):
    rows = np.array([[2 * i, 2 * j, LINES[j, i]] for i in range(15) for j in range(12)])
    np.save(tmp_path / "face.npy", rows[5:])
    found = read_for_a_look(tmp_path / "face.npy", **MICRONS)
    same(found, without(*((0, j) for j in range(5))))


def test_points_that_are_not_on_a_grid_are_refused(tmp_path):
    scattered = np.random.default_rng(2).random((200, 3))
    said = r"200 lines x y z, whose points lie on no regular grid .*griddata"
    refused(tmp_path, matrix(" ", lines=scattered), said, **MICRONS)
    refused(tmp_path, table() + "\n2 4 9.9\n", "several heights at x = 2, y = 4", **MICRONS)
    same(look(tmp_path, 2 * (table() + "\n"), **MICRONS))  # the same ones


def test_the_lattice_of_rounded_values_is_found():
    values = np.repeat([0.0, 1.4, 2.8, 4.1, 5.5, 13.8, 15.2], 2)  # of 1.38, in one digit
    found = find_lattice(values)
    assert found.points == 12
    assert_allclose(found.step, 1.38, rtol=2e-3)
    assert found.index[::2].tolist() == [0, 1, 2, 3, 4, 10, 11]
    jitter = 1e-9 * np.random.default_rng(0).standard_normal((50, 40))
    found = find_lattice((np.arange(40.0) + jitter).ravel())
    assert (found.points, round(found.step, 6)) == (40, 1.0)
    assert find_lattice(np.random.default_rng(0).random(100)) is None
    assert find_lattice(np.array([0.0, np.nan])) is None


# --- profiles ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (lambda x, z: np.array([x, z]).T, "200 points .two columns, x and z; Ra 0.6.., Rq 0.70"),
        (lambda x, z: np.array([x, z]), "200 points .two lines, x and z"),
        (lambda x, z: z[:, None], "200 points .a single column"),
        (lambda x, z: z[None], "200 points .a single line"),
        (lambda x, z: np.array([x, 0 * x, z]).T, "200 points .coordinates x y z along one line"),
    ],
)
def test_profiles_in_texts_are_refused_with_advice(tmp_path, text, found):
    """A map is needed; a profile says what makes a face. Of a sine Ra is 2/π and Rq √½ of the amplitude."""
    n = np.arange(200)
    lines = text(0.5 * n, np.sin(2 * np.pi * (n + 0.5) / 20))
    match = f"given a profile of {found}.*expected a map, .* kind = 'self-affine', or with pitch and depth"
    refused(tmp_path, matrix(" ", lines=lines), match, **MICRONS)
    refused(tmp_path, "x [mm] z [um]\n" + matrix(" ", lines=lines), match, **MICRONS)


def test_profiles_in_other_files_are_refused(tmp_path):
    np.save(tmp_path / "face.npy", np.zeros((1, 50)))
    with pytest.raises(InputError, match="a profile of 50 points"):
        read_topography(tmp_path / "face.npy", **MICRONS)


# --- what is assumed is said ------------------------------------------------------------------------------


def test_notes_are_logged(tmp_path, caplog):
    path = tmp_path / "face.txt"
    path.write_text(table(missing=MISSING))
    with caplog.at_level(logging.WARNING, "femseal.topography"):
        read_topography(path, **MICRONS)
    assert "15 points (8.33 %) are missing" in caplog.text


LARGE = """
import sys
import femseal as fs
from femseal.base.machine import peak_memory

used = []
for path in sys.argv[1:]:  # the first loads what reading takes
    try:
        fs.read_topography(path, spacing=(1e-6, 1e-6), height_unit="um")
    except fs.InputError as error:
        print(error)
    used.append(peak_memory())
print(used[1] - used[0])
"""


@pytest.mark.parametrize(
    "kind",
    ["grid", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("profile", "scattered"))],
)
def test_a_large_table_takes_ten_times_its_size(tmp_path, kind):
    """A text of 6 MB, in a process of its own."""
    rng = np.random.default_rng(0)
    for name, n in (("small", 20), ("large", 550)):
        columns = [*np.indices((n, n)).reshape(2, -1), rng.standard_normal(n * n)]
        if kind == "scattered":
            columns[:2] = rng.random((2, n * n))
        if kind == "profile":
            columns = [np.arange(n * n), columns[2]]
        np.savetxt(tmp_path / f"{name}.txt", np.array(columns).T[3:], "%.5f")
    paths = [tmp_path / "small.txt", tmp_path / "large.txt"]
    done = subprocess.run(
        [sys.executable, "-c", LARGE, *paths], capture_output=True, text=True, check=True
    )
    *said, used = done.stdout.splitlines()
    assert len(said) == 2 * (kind != "grid")
    assert int(used) < 10 * paths[1].stat().st_size
