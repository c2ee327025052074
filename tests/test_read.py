"""Readers: files made here, in every format, and measured ones where they are at hand."""

import sys
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_allclose

from femseal.base.errors import InputError
from femseal.topography import read_topography

Z = np.array([[1.0, 2.0, np.nan], [4.0, -5.0, 6.5]]) * 1e-6
PIXEL = (2e-6, 3e-6)


def same(face, heights=Z, spacing=PIXEL, rtol=1e-6):
    assert_allclose(face.heights, heights, rtol=rtol)
    assert_allclose(face.spacing, spacing)


def write(folder, name, text):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# --- NumPy ------------------------------------------------------------------------------------------------


def test_npy(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z)
    same(read_topography(path, spacing=PIXEL))
    same(read_topography(str(path), size=(4e-6, 9e-6)))
    assert read_topography(path, spacing=PIXEL).periodic == (False, False)
    assert read_topography(path, spacing=PIXEL, periodic=(False, True)).periodic == (False, True)


def test_transposed_pairs_refer_to_the_result(tmp_path):
    path = tmp_path / "face.npz"
    np.savez(path, z=Z, spacing=PIXEL)
    same(read_topography(path, transpose=True), Z.T, PIXEL[::-1])
    same(read_topography(path, transpose=True, spacing=(1e-6, 5e-6)), Z.T, (1e-6, 5e-6))
    same(read_topography(path, transpose=True, size=(6e-6, 8e-6)), Z.T, (2e-6, 4e-6))


def test_height_unit(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z * 1e9)
    same(read_topography(path, spacing=PIXEL, height_unit="nm"))
    np.save(path, np.array([[1, 2], [3, 4]], dtype=np.int16))
    same(read_topography(path, spacing=PIXEL, height_unit="um"), [[1e-6, 2e-6], [3e-6, 4e-6]])
    with pytest.raises(InputError, match="height_unit: given '1 furlongs-ish'"):
        read_topography(path, spacing=PIXEL, height_unit="furlongs-ish")


def test_implausible_heights_are_read_when_the_caller_confirms_the_unit(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z * 1e6)
    with pytest.raises(InputError, match="allowed is at most 10 mm"):
        read_topography(path, spacing=PIXEL)
    same(read_topography(path, spacing=PIXEL, height_unit="m"), Z * 1e6)


def test_npz(tmp_path):
    path = tmp_path / "face.npz"
    np.savez(path, only=Z)
    same(read_topography(path, spacing=PIXEL))
    np.savez(path, a=Z, b=2 * Z, spacing=PIXEL)
    same(read_topography(path, array="b"), 2 * Z)
    same(read_topography(path, array="a", spacing=(1e-6, 1e-6)), spacing=(1e-6, 1e-6))
    with pytest.raises(InputError, match="given the arrays a, b, allowed is one array, or array="):
        read_topography(path)
    with pytest.raises(InputError, match="given array='c', allowed is one of its arrays: a, b"):
        read_topography(path, array="c")
    np.savez(path, a=Z, spacing=1e-6)
    with pytest.raises(InputError, match=r"a spacing of shape \(\)"):
        read_topography(path)


@pytest.mark.parametrize("array", [np.zeros(4), np.zeros((2, 2, 2)), np.zeros((0, 2)), np.full((2, 2), "a")])
def test_arrays_that_are_no_map(tmp_path, array):
    path = tmp_path / "face.npy"
    np.save(path, array)
    with pytest.raises(InputError, match=r"face\.npy: given an array of .* real numbers of shape \(n1, n2\)"):
        read_topography(path, spacing=PIXEL)


# --- text -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "   ", ", "])
@pytest.mark.parametrize("suffix", [".csv", ".txt", ".asc", ".TXT"])
def test_text_delimiters_are_found(tmp_path, delimiter, suffix):
    text = "# measured\n\n" + "".join(delimiter.join(f"{v!r}" for v in row) + "\r\n" for row in Z.tolist())
    same(read_topography(write(tmp_path, f"face{suffix}", text), spacing=PIXEL), Z.T)


def test_given_delimiter(tmp_path):
    path = write(tmp_path, "face.txt", "1e-6|2e-6\n3e-6|4e-6\n")
    same(read_topography(path, spacing=PIXEL, delimiter="|"), [[1e-6, 3e-6], [2e-6, 4e-6]])
    with pytest.raises(InputError, match=r"'1e-6\|2e-6' in line 1"):
        read_topography(path, spacing=PIXEL)


@pytest.mark.parametrize(
    "text",
    [
        "1e-6,2e-6,\n4e-6,-5e-6,6.5e-6\n",  # empty field
        "1e-6;2e-6;nan\n4e-6;-5e-6;6.5e-6\n",
        "1e-6;2e-6;;\n4e-6;-5e-6;6.5e-6;\n",  # a delimiter also behind the last number
        "1e-6\t2e-6\t\n4e-6\t-5e-6\t6.5e-6\n",
        "1e-6 2e-6 BAD\n4e-6 -5e-6 6.5e-6",
        "\ufeff1e-6,2e-6,---\n4e-6,-5e-6,6.5e-6\n".replace("---", "--"),
    ],
)
def test_undefined_points_of_text(tmp_path, text):
    same(read_topography(write(tmp_path, "face.csv", text), spacing=PIXEL), Z.T)


def test_text_header_with_sides_and_unit(tmp_path):
    text = "# Channel: height\n# Width: 9 um\n# Height: 4 µm\n# Value units: nm\n1 2 3\n4 5 6\n"
    path = write(tmp_path, "face.txt", text)
    lines = np.arange(1, 7).reshape(2, 3).T
    same(read_topography(path), lines * 1e-9, (3e-6, 2e-6))
    same(read_topography(path, transpose=True), lines.T * 1e-9)
    same(read_topography(path, spacing=(1, 1), height_unit="um"), lines * 1e-6, (1, 1))
    with pytest.raises(InputError, match="a header with width: given '9 apples'"):
        read_topography(write(tmp_path, "face.txt", text.replace("9 um", "9 apples")))


def test_text_lies_as_the_same_face_of_an_instrument(tmp_path):
    """x of the file is x1: a text, one line for each y, and the standard's format of the same face."""
    import x3pio

    z = np.random.default_rng(0).standard_normal((5, 7)) * 1e-6  # x, y
    path = tmp_path / "face.x3p"
    x3pio.write(path, z.T, x_scale=3e-6, y_scale=2e-6)
    text = "# Width: 15 um\n# Height: 14 um\n" + "\n".join(" ".join(f"{v:.17g}" for v in line) for line in z.T)
    same(read_topography(write(tmp_path, "face.txt", text)), z, (3e-6, 2e-6), rtol=1e-15)
    same(read_topography(path), z, (3e-6, 2e-6))


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_decimal_commas_and_a_german_header(tmp_path, delimiter):
    text = "# Kanal: Höhe\n# Breite: 9,0 um\n# Höhe: 4,0 µm\n# Werteeinheiten: nm\n"
    text += "\n".join(delimiter.join(f"{v},5" for v in line) for line in ((1, 2, 3), (4, 5, 6)))
    same(
        read_topography(write(tmp_path, "face.txt", text)), (np.arange(1, 7) + 0.5).reshape(2, 3).T * 1e-9, (3e-6, 2e-6)
    )


def test_triplets_are_a_grid_in_any_order(tmp_path):
    rng = np.random.default_rng(0)
    z = rng.standard_normal((4, 5)) * 1e-6
    z[1, 2] = np.nan
    i, j = (n.ravel() for n in np.indices(z.shape))
    order = rng.permutation(z.size)
    lines = [f"{1e-3 + 3e-6 * i[n]:.12g}, {2e-6 * j[n]:.12g}, {z[i[n], j[n]]:.12g}" for n in order]
    same(read_topography(write(tmp_path, "face.csv", "\n".join(lines))), z, (3e-6, 2e-6))
    # one point short of a grid: an ordinary matrix of three columns, whose pixel is not said
    with pytest.raises(InputError, match="no pixel size"):
        read_topography(write(tmp_path, "face.csv", "\n".join(lines[:-1])))


def test_esri_raster(tmp_path):
    head = "ncols 3\nNROWS 2\nxllcorner 0\nyllcorner 0\ncellsize 2e-6\nNODATA_value -9\n"
    text = head + "1e-6 2e-6 -9\n4e-6 -5e-6\n6.5e-6\n"
    same(read_topography(write(tmp_path, "face.asc", text)), Z.T, spacing=(2e-6, 2e-6))
    oblong = text.replace("cellsize 2e-6", "dx 3e-6\ndy 2e-6")
    same(read_topography(write(tmp_path, "face.asc", oblong)), Z.T, spacing=(3e-6, 2e-6))
    with pytest.raises(InputError, match=r"given 6 numbers, allowed is nrows × ncols = 3 × 3"):
        read_topography(write(tmp_path, "face.asc", text.replace("NROWS 2", "NROWS 3")))
    with pytest.raises(InputError, match=r"given a header with ncols, nrows, .* cellsize"):
        read_topography(write(tmp_path, "face.asc", text.replace("cellsize 2e-6\n", "")))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n3\n", "given 1 numbers in line 2 after 2 in line 1"),
        ("1;2\n3;x4\n", "given 'x4' in line 2, allowed is numbers with a decimal point"),
        ("1.5;2,5\n", "given '2,5' in line 1"),
        ("1,5;2,5,1\n", "given '2,5,1' in line 1"),
        ("# nothing\n", "given no line with numbers"),
        ("", "given no line with numbers"),
        (b"\xff\xfe\x00\x01", "bytes that are not UTF-8 text"),
        ("1 inf\n2 3\n", r"face\.txt: heights: given 1 infinite points"),
    ],
)
def test_bad_text(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_topography(write(tmp_path, "face.txt", text), spacing=PIXEL)


# --- instrument formats -----------------------------------------------------------------------------------


def test_x3p(tmp_path):
    import x3pio

    path = tmp_path / "face.x3p"
    x3pio.write(path, Z.T, x_scale=PIXEL[0], y_scale=PIXEL[1])  # rows of the format are y
    same(read_topography(path))
    x3pio.write(path, np.stack([Z.T, 2 * Z.T]), x_scale=PIXEL[0], y_scale=PIXEL[1])
    same(read_topography(path, channel=1), 2 * Z)
    with pytest.raises(InputError, match="given channel=2, allowed is 0 to 1, it has 2 layers"):
        read_topography(path, channel=2)
    x3pio.write(path, Z[1], x_scale=1e-6)
    with pytest.raises(InputError, match="given a Profile on no regular grid"):
        read_topography(path)


def test_x3p_agrees_with_an_independent_reader(tmp_path):
    pytest.importorskip("SurfaceTopography", reason="the extra femseal[surface] is not installed")
    import x3pio
    from SurfaceTopography import read_topography as independent

    path = tmp_path / "face.x3p"
    z = np.random.default_rng(0).standard_normal((7, 5)) * 1e-6
    x3pio.write(path, z.T, x_scale=PIXEL[0], y_scale=PIXEL[1])
    x3pio.read(path).with_revision(x3pio.Revision.ISO5436_2000, drop_extensions=True).save(path)
    same(read_topography(path), independent(str(path)).heights(), rtol=1e-12)


@pytest.mark.parametrize("kind", ["ASCII", "BINARY"])
def test_sdf(tmp_path, kind):
    import sdfio

    path = tmp_path / "face.sdf"
    sdfio.write(path, Z.T, x_scale=PIXEL[0], y_scale=PIXEL[1], format=sdfio.FileFormat[kind])
    same(read_topography(path))
    with pytest.raises(InputError, match="given channel=1"):
        read_topography(path, channel=1)


def test_sdf_written_by_hand_in_micrometres_is_refused_and_corrected(tmp_path):
    text = (
        "aISO-1.0\r\nManufacID = hand\r\nCreateDate = 010120200000\r\nModDate = 010120200000\r\n"
        "NumPoints = 3\r\nNumProfiles = 2\r\nXscale = 2\r\nYscale = 3\r\nZscale = 1\r\nZresolution = -1\r\n"
        "Compression = 0\r\nDataType = 7\r\nCheckType = 0\r\n*\r\n1.0 2.0 3.0\r\n4.0 5.0 7.0\r\n*\r\n*\r\n"
    )
    path = write(tmp_path, "face.sdf", text)
    with pytest.raises(InputError, match=r"given a size of 6 m × 6 m, allowed is 1 nm to 1 m; .* pass size="):
        read_topography(path)
    with pytest.raises(InputError, match=r"given Sq = 1\.972 m, allowed is at most 10 mm; .* pass height_unit="):
        read_topography(path, spacing=PIXEL)
    corrected = read_topography(path, spacing=PIXEL, height_unit="um")
    same(corrected, np.array([[1.0, 4.0], [2.0, 5.0], [3.0, 7.0]]) * 1e-6)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".x3p", ".sdf"])
@pytest.mark.parametrize("content", [b"", b"not what the suffix says " * 9])
def test_damaged_files(tmp_path, suffix, content):
    path = write(tmp_path, f"face{suffix}", content)
    with pytest.raises(InputError, match=rf"face\{suffix}: given .*, allowed is ") as error:
        read_topography(path, spacing=PIXEL)
    assert "\n" not in str(error.value)


def test_truncated_archives(tmp_path):
    np.savez(tmp_path / "whole.npz", a=np.zeros((50, 50)))
    path = write(tmp_path, "face.npz", (tmp_path / "whole.npz").read_bytes()[:300])
    with pytest.raises(InputError, match=r"numpy\.savez"):
        read_topography(path, spacing=PIXEL)
    with zipfile.ZipFile(tmp_path / "face.x3p", "w") as archive:
        archive.writestr("main.xml", "<p>")
    with pytest.raises(InputError, match=r"intact \.x3p file"):
        read_topography(tmp_path / "face.x3p")


def test_other_formats_need_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    path = write(tmp_path, "face.opd", b"x")
    with pytest.raises(InputError, match=r"a file of kind '\.opd', .* pip install 'femseal\[surface\]'"):
        read_topography(path)


def test_unknown_format(tmp_path):
    pytest.importorskip("SurfaceTopography", reason="the extra femseal[surface] is not installed")
    with pytest.raises(InputError, match=r"face\.xyw: given .*, allowed is a file of one of the formats"):
        read_topography(write(tmp_path, "face.xyw", b"\x00\x01no such format"))


@pytest.mark.parametrize(
    ("heights", "spacing", "message", "correction"),
    [
        (Z, (0.25, 0.2), None, {}),
        (Z, (80.0, 60.0), r"a size of 160 m × 180 m, .* pass size= \(--size\)", {"size": (4e-6, 9e-6)}),
        (Z, (1e-12, 1e-6), r"a size of 2 pm × 3 µm, .* pass size= \(--size\)", {"spacing": PIXEL}),
        (Z, (0.0, 1e-6), r"a pixel of 0 m × 1e-06 m, .* pass spacing= or size= \(--spacing, --size\)", {"spacing": PIXEL}),
        (Z, (-1e-6, 1e-6), r"a pixel of -1e-06 m × 1e-06 m, .* two lengths > 0", {"size": (4e-6, 9e-6)}),
        (Z, (np.nan, 1e-6), r"a pixel of nan m", {"size": (4e-6, 9e-6)}),
        (Z / 4e-6, (0.2, 0.2), r"Sq = 9\d+\.\d mm, .* pass height_unit= such as 'um' \(--height-unit\)", {"height_unit": "um"}),
        (Z * 100, PIXEL, r"a slope of \d+ on half of its points, .* \(--size, --height-unit\)", {"height_unit": "um"}),
        (Z * 100, PIXEL, "a slope of", {"spacing": (2e-4, 3e-4)}),
        (Z * 100, PIXEL, "a slope of", {"spacing": PIXEL, "height_unit": "m"}),
    ],
)  # fmt: skip
def test_what_only_a_wrong_unit_explains_is_refused_with_the_way_to_correct_it(
    tmp_path, heights, spacing, message, correction
):
    path = tmp_path / "face.npz"
    np.savez(path, z=heights, spacing=spacing)
    if message is not None:
        with pytest.raises(InputError, match=message):
            read_topography(path)
    read_topography(path, **correction)


def test_spikes_do_not_make_a_face_too_steep(tmp_path):
    z = np.zeros((50, 50))
    z[::5, ::5] = 1e-3
    np.savez(tmp_path / "face.npz", z=z, spacing=PIXEL)
    assert read_topography(tmp_path / "face.npz").rms_slope > 10


# --- what the caller gets wrong ---------------------------------------------------------------------------


def test_no_file(tmp_path):
    with pytest.raises(InputError, match=r"none\.npy: given no such file, allowed is a file with heights"):
        read_topography(tmp_path / "none.npy")
    with pytest.raises(InputError, match="given a folder"):
        read_topography(tmp_path)


def test_missing_or_doubled_size(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z)
    with pytest.raises(
        InputError, match=r"no pixel size in the file \(2 × 3 points\), allowed is two lengths in size= or spacing="
    ):
        read_topography(path)
    with pytest.raises(InputError, match="size, spacing: given both, allowed is one of the two"):
        read_topography(path, size=(1, 1), spacing=PIXEL)
    with pytest.raises(InputError, match="spacing: given"):
        read_topography(path, spacing=(0.0, 1.0))


def test_options_of_other_formats_are_refused(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z)
    for given in ({"array": "z"}, {"delimiter": ","}, {"channel": 1}):
        with pytest.raises(InputError, match=f"{next(iter(given))}: given .* only, not face.npy"):
            read_topography(path, spacing=PIXEL, **given)


# --- measured surfaces ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "shape", "size", "sq", "undefined"),
    [
        ("plu-1.plu", (768, 576), (1.275e-3, 0.956e-3), 18.3e-9, 0.0),
        ("surfalize_test_1.opd", (736, 480), (1.203e-3, 0.915e-3), 1.93e-6, 0.0023),
        ("x3p-2.x3p", (650, 650), (83.0e-6, 204.5e-6), 77e-9, 0.0),
        ("opd-1.opd", (640, 480), (125.9e-6, 94.4e-6), 6.7e-9, 0.0004),
    ],
)
def test_measured_surfaces(instrument_file, name, shape, size, sq, undefined):
    face = read_topography(instrument_file(name))
    assert face.shape == shape
    assert_allclose(face.size, size, rtol=1e-3)
    assert_allclose(np.nanstd(face.detrend().heights), sq, rtol=5e-3)
    assert_allclose(face.undefined_share, undefined, atol=5e-5)
    assert face.fill_undefined().undefined_share == 0


def test_measured_surface_in_a_wrong_channel(instrument_file):
    with pytest.raises(InputError, match="given channel=1, allowed is 0 to 0, it has 1 channels"):
        read_topography(instrument_file("plu-1.plu"), channel=1)
