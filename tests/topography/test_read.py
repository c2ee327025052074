"""Readers: files made here, in every format."""

import os
import random
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from instrument_files import WRITERS
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
    with pytest.raises(InputError, match="expected at most 10 mm"):
        read_topography(path, spacing=PIXEL)
    same(read_topography(path, spacing=PIXEL, height_unit="m"), Z * 1e6)


def test_npz(tmp_path):
    path = tmp_path / "face.npz"
    np.savez(path, only=Z)
    same(read_topography(path, spacing=PIXEL))
    np.savez(path, a=Z, b=2 * Z, spacing=PIXEL)
    same(read_topography(path, array="b"), 2 * Z)
    same(read_topography(path, array="a", spacing=(1e-6, 1e-6)), spacing=(1e-6, 1e-6))
    with pytest.raises(InputError, match="given the arrays a, b, expected one array, or array="):
        read_topography(path)
    with pytest.raises(InputError, match="given array='c', expected one of its arrays: a, b"):
        read_topography(path, array="c")
    np.savez(path, a=Z, spacing=PIXEL, step=3, name="loading")
    same(read_topography(path), Z)
    np.savez(path, a=Z, spacing=1e-6)
    with pytest.raises(InputError, match=r"a spacing of shape \(\)"):
        read_topography(path)


@pytest.mark.parametrize(
    "array", [np.zeros(4), np.zeros((2, 2, 2)), np.zeros((0, 2)), np.full((2, 2), "a")]
)
def test_arrays_that_are_no_map(tmp_path, array):
    path = tmp_path / "face.npy"
    np.save(path, array)
    with pytest.raises(
        InputError, match=r"face\.npy: given an array of .* real numbers of shape \(n1, n2\)"
    ):
        read_topography(path, spacing=PIXEL)


# --- text -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "   ", ", "])
@pytest.mark.parametrize("suffix", [".csv", ".txt", ".asc", ".TXT"])
def test_text_delimiters_are_found(tmp_path, delimiter, suffix):
    text = "# measured\n\n" + "".join(
        delimiter.join(f"{v!r}" for v in row) + "\r\n" for row in Z.tolist()
    )
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
    text = "# Width: 15 um\n# Height: 14 um\n" + "\n".join(
        " ".join(f"{v:.17g}" for v in line) for line in z.T
    )
    same(read_topography(write(tmp_path, "face.txt", text)), z, (3e-6, 2e-6), rtol=1e-15)
    same(read_topography(path), z, (3e-6, 2e-6))


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_decimal_commas(tmp_path, delimiter):
    text = "# Width: 9,0 um\n# Height: 4,0 µm\n# Value units: nm\n"
    text += "\n".join(delimiter.join(f"{v},5" for v in line) for line in ((1, 2, 3), (4, 5, 6)))
    heights = (np.arange(1, 7) + 0.5).reshape(2, 3).T * 1e-9
    same(read_topography(write(tmp_path, "face.txt", text)), heights, (3e-6, 2e-6))


@pytest.mark.parametrize(
    "header", ["# Breite: 9,0 um", "#Höhe = 4 µm", "# Werteeinheiten: nm", "# Einheit der Werte: m"]
)
def test_a_german_header_is_refused_with_what_to_write(tmp_path, header):
    path = write(tmp_path, "face.txt", f"# Kanal: z\n{header}\n1 2\n3 4\n")
    with pytest.raises(
        InputError,
        match=r"in line 2, expected the header in English, '# Width: 1 mm', .*units: nm'",
    ):
        read_topography(path, spacing=PIXEL)


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


def test_an_esri_raster_is_refused_with_what_to_do(tmp_path):
    head = "ncols 3\nNROWS 2\nxllcorner 0\nyllcorner 0\ncellsize 2e-6\nNODATA_value -9\n"
    text = head + "1e-6 2e-6 nan\n4e-6 -5e-6 6.5e-6\n"
    message = r"given 'ncols' in line 1, .* put # before the lines of a header, .* \(--spacing, --size, --height-unit\)"
    with pytest.raises(InputError, match=message):
        read_topography(write(tmp_path, "face.asc", text))
    done = "".join(f"# {line}\n" for line in head.splitlines()) + text.removeprefix(head)
    same(
        read_topography(write(tmp_path, "face.asc", done), spacing=(2e-6, 2e-6)),
        Z.T,
        spacing=(2e-6, 2e-6),
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n3\n", "given 1 number in line 2 after 2 in line 1"),
        ("1;2\n3;x4\n", "given 'x4' in line 2, expected numbers with a decimal point"),
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
    with pytest.raises(InputError, match="given channel=2, expected 0 to 1, it has 2 layers"):
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
    with pytest.raises(
        InputError, match=r"given a size of 6 m × 6 m, expected 1 nm to 1 m; .* pass size="
    ):
        read_topography(path)
    with pytest.raises(
        InputError, match=r"given Sq = 1\.972 m, expected at most 10 mm; .* pass height_unit="
    ):
        read_topography(path, spacing=PIXEL)
    corrected = read_topography(path, spacing=PIXEL, height_unit="um")
    same(corrected, np.array([[1.0, 4.0], [2.0, 5.0], [3.0, 7.0]]) * 1e-6)


@pytest.mark.parametrize("suffix", [".npy", ".npz", ".x3p", ".sdf"])
@pytest.mark.parametrize("content", [b"", b"not what the suffix says " * 9])
def test_damaged_files(tmp_path, suffix, content):
    path = write(tmp_path, f"face{suffix}", content)
    with pytest.raises(InputError, match=rf"face\{suffix}: given .*, expected ") as error:
        read_topography(path, spacing=PIXEL)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "kind", ["npy", "npz", "packed.npz", "csv", "asc", "x3p", "ASCII.sdf", "BINARY.sdf"]
)
def test_one_damaged_byte_is_no_error_of_a_library(tmp_path, kind):
    """A file with a wrong byte is read, or refused with its name."""
    import sdfio
    import x3pio

    path, z = tmp_path / f"face.{kind}", np.arange(20.0).reshape(4, 5) * 1e-7
    if kind == "npy":
        np.save(path, z)
    elif kind.endswith("npz"):
        (np.savez_compressed if "packed" in kind else np.savez)(path, heights=z, spacing=PIXEL)
    elif kind == "x3p":
        x3pio.write(path, z, x_scale=1e-6, y_scale=1e-6)
    elif kind.endswith("sdf"):
        sdfio.write(path, z, x_scale=1e-6, y_scale=1e-6, format=sdfio.FileFormat[kind[:-4]])
    else:
        head = "# Width: 1 mm\n# Height: 2 mm\n"
        path.write_text(
            head
            + "\n".join((" " if kind == "asc" else ";").join(f"{h:g}" for h in row) for row in z)
        )
    whole, refused = path.read_bytes(), 0
    for at in range(0, len(whole), 1 + len(whole) // 200):
        for byte in (0, 255, ord("("), ord("n"), whole[at] ^ 1):
            path.write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
            try:
                read_topography(path, spacing=PIXEL)
            except InputError:
                refused += 1
    assert refused > 0


def test_truncated_archives(tmp_path):
    np.savez(tmp_path / "whole.npz", a=np.zeros((50, 50)))
    path = write(tmp_path, "face.npz", (tmp_path / "whole.npz").read_bytes()[:300])
    with pytest.raises(InputError, match=r"intact \.npz file"):
        read_topography(path, spacing=PIXEL)
    with zipfile.ZipFile(tmp_path / "face.x3p", "w") as archive:
        archive.writestr("main.xml", "<p>")
    with pytest.raises(InputError, match=r"intact \.x3p file"):
        read_topography(tmp_path / "face.x3p")


def test_other_formats_need_the_extra(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    path = write(tmp_path, "face.opd", b"x")
    with pytest.raises(
        InputError, match=r"a file of kind '\.opd', .* pip install 'femseal\[surface\]'"
    ):
        read_topography(path)


def test_what_readers_print_of_damaged_files_is_not_seen(tmp_path, monkeypatch, capfd):
    """From Python, and from below it; what is printed later is."""

    def printing(path):
        print("bytes of the file")
        print("and more of them", file=sys.stderr)
        os.write(1, b"\x00\x01")
        os.write(2, b"\x02\x03")
        raise ValueError

    library = type(sys)("SurfaceTopography")
    library.open_topography = printing
    monkeypatch.setitem(sys.modules, "SurfaceTopography", library)
    with pytest.raises(InputError, match="formats known to SurfaceTopography"):
        read_topography(write(tmp_path, "face.opd", b"x"))
    print("later")
    os.write(2, b"later too")
    assert capfd.readouterr() == ("later\n", "later too")


def test_a_damaged_opd_file_prints_nothing(tmp_path):
    """In a process of its own: its library logs what it finds, and tests catch what is logged."""
    content = bytearray(WRITERS[".opd"](np.tile(Z, (8, 8)), PIXEL))
    generator = random.Random(1)
    for number in range(4):
        damaged = content[: generator.randrange(100, len(content)) if number % 2 else None]
        for _ in range(generator.choice([1, 20])):
            damaged[generator.randrange(min(len(damaged), 4000))] = generator.randrange(256)
        write(tmp_path, f"face{number}.opd", bytes(damaged))
    code = (
        "import sys, femseal as fs\n"
        "for path in sys.argv[1:]:\n"
        "    try: fs.read_topography(path)\n"
        "    except fs.InputError: pass\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *tmp_path.glob("*.opd")], capture_output=True, check=True
    )
    assert (len(done.stdout), len(done.stderr)) == (0, 0)


def test_unknown_format(tmp_path):
    pytest.importorskip("SurfaceTopography", reason="the extra femseal[surface] is not installed")
    message = (
        r"face\.xyw: given .*, expected a file of one of the formats .* \.plu .* export \.x3p too$"
    )
    with pytest.raises(InputError, match=message):
        read_topography(write(tmp_path, "face.xyw", b"\x00\x01no such format"))


@pytest.mark.parametrize(
    ("heights", "spacing", "message", "correction"),
    [
        (Z, (0.25, 0.2), None, {}),
        (
            Z,
            (80.0, 60.0),
            r"a size of 160 m × 180 m, .* pass size= \(--size\)",
            {"size": (4e-6, 9e-6)},
        ),
        (Z, (1e-12, 1e-6), r"a size of 2 pm × 3 µm, .* pass size= \(--size\)", {"spacing": PIXEL}),
        (
            Z,
            (0.0, 1e-6),
            r"a pixel of 0 m × 1e-06 m, .* pass spacing= or size= \(--spacing, --size\)",
            {"spacing": PIXEL},
        ),
        (
            Z,
            (-1e-6, 1e-6),
            r"a pixel of -1e-06 m × 1e-06 m, .* two lengths > 0",
            {"size": (4e-6, 9e-6)},
        ),
        (Z, (np.nan, 1e-6), r"a pixel of nan m", {"size": (4e-6, 9e-6)}),
        (
            Z / 4e-6,
            (0.2, 0.2),
            r"Sq = 9\d+\.\d mm, .* pass height_unit= such as 'um' \(--height-unit\)",
            {"height_unit": "um"},
        ),
        (
            Z * 100,
            PIXEL,
            r"a slope of \d+ on half of its points, .* \(--size, --height-unit\)",
            {"height_unit": "um"},
        ),
        (Z * 100, PIXEL, "a slope of", {"spacing": (2e-4, 3e-4)}),
        (Z * 100, PIXEL, "a slope of", {"spacing": PIXEL, "height_unit": "m"}),
    ],
)
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


# --- masks and parts --------------------------------------------------------------------------------------


MASK = np.array([[False, True, False], [True, False, False]])  # of Z, x first


def masked(heights=Z, mask=MASK):
    return np.where(mask, np.nan, heights)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".gif", ".npy", ".csv", ".txt"])
def test_points_are_masked_by_a_file(tmp_path, suffix):
    """A line of an image or a text runs along the file's x; an array lies as those of NumPy."""
    from PIL import Image

    np.savez(tmp_path / "face.npz", z=Z, spacing=PIXEL)
    path = tmp_path / f"mask{suffix}"
    if suffix == ".npy":
        np.save(path, MASK)
    elif suffix in (".csv", ".txt"):
        np.savetxt(path, MASK.T, "%d")
    else:
        Image.fromarray((MASK.T * 255).astype(np.uint8)).save(path)
    same(read_topography(tmp_path / "face.npz", mask=path), masked())
    same(read_topography(tmp_path / "face.npz", mask=path, transpose=True), masked().T, PIXEL[::-1])


@pytest.mark.parametrize("mode", ["1", "RGB", "RGBA", "P", "I;16"])
def test_images_of_every_kind_mask_where_they_are_not_black(tmp_path, mode):
    from PIL import Image

    np.savez(tmp_path / "face.npz", z=Z, spacing=PIXEL)
    if mode == "I;16":
        image = Image.fromarray(MASK.T.astype(np.uint16) * 300)
    else:
        image = Image.fromarray((MASK.T * 255).astype(np.uint8)).convert(mode)
    image.save(tmp_path / "mask.png")
    same(read_topography(tmp_path / "face.npz", mask=tmp_path / "mask.png"), masked())


def test_masks_that_do_not_fit(tmp_path):
    np.savez(tmp_path / "face.npz", z=Z, spacing=PIXEL)
    np.save(tmp_path / "mask.npy", MASK.T)
    cases = {
        "mask.npy": r"mask: given 3 × 2 points in 'mask.npy', expected 2 × 3, .*; turned by its diagonal it would fit",
        "none.png": r"mask: given '.*none.png', no such file",
        "mask.jpg": r"mask: given 'mask.jpg', expected a file \.png, ",
        "bad.png": r"bad.png: given .*, expected a file that can be read",
        "bad.npy": r"bad.npy: given .*, expected an intact \.npy file",
    }
    for name in ("mask.jpg", "bad.png", "bad.npy"):
        write(tmp_path, name, "no mask")
    for name, message in cases.items():
        with pytest.raises(InputError, match=message):
            read_topography(tmp_path / "face.npz", mask=tmp_path / name)


def test_the_mask_of_a_gwyddion_file(tmp_path):
    """Its points are undefined, or have their heights; a second mask comes on top."""
    surfaces = pytest.importorskip(
        "SurfaceTopography", reason="the extra femseal[surface] is not installed"
    )
    z = np.nan_to_num(Z) * 1e6
    path = tmp_path / "face.gwy"
    surfaces.Topography(np.ma.masked_array(z, MASK), (4.0, 9.0), unit="µm").to_gwy(str(path))
    same(read_topography(path), masked(z * 1e-6))
    # the writer puts 0 under the mask
    same(read_topography(path, file_mask=False), np.where(MASK, 0, z * 1e-6))
    np.save(tmp_path / "mask.npy", ~MASK)
    with pytest.raises(
        InputError, match=r"file_mask: given False, expected for \.gwy, \.npz files only"
    ):
        read_topography(tmp_path / "mask.npy", file_mask=False)
    assert read_topography(path, mask=tmp_path / "mask.npy").undefined_fraction == 1


def test_heights_under_the_mask_of_a_gwyddion_file_have_their_unit(tmp_path, monkeypatch):
    """The library scales only what is not masked."""
    surfaces = pytest.importorskip(
        "SurfaceTopography", reason="the extra femseal[surface] is not installed"
    )
    z = np.nan_to_num(Z) * 1e6 + 1
    path = tmp_path / "face.gwy"
    surfaces.Topography(z, (4.0, 9.0), unit="µm").to_gwy(str(path))
    plain = path.read_bytes()
    surfaces.Topography(np.ma.masked_array(z, MASK), (4.0, 9.0), unit="µm").to_gwy(str(path))
    content = path.read_bytes()
    # the heights of the file without a mask into the one with it
    heights = (z * 1e-6).T.astype("<f8").tobytes()
    holed = np.where(MASK, 0, z * 1e-6).T.astype("<f8").tobytes()
    assert heights in plain
    assert content.count(holed) == 1
    path.write_bytes(content.replace(holed, heights))
    same(read_topography(path), masked(z * 1e-6))
    same(read_topography(path, file_mask=False), z * 1e-6)


def test_the_mask_of_an_npz(tmp_path):
    path = tmp_path / "face.npz"
    np.savez(path, z=Z, spacing=PIXEL, mask=MASK)
    same(read_topography(path), masked())
    same(read_topography(path, file_mask=False))
    np.savez(path, z=Z, spacing=PIXEL, mask=MASK.T)
    with pytest.raises(InputError, match=r"given an array mask of bool of shape \(3, 2\)"):
        read_topography(path)


def test_a_part_of_a_map(tmp_path):
    path = tmp_path / "face.npz"
    np.savez(path, z=Z, spacing=PIXEL)
    same(read_topography(path, crop=(0, 4e-6, 3e-6, 9e-6)), Z[:, 1:])
    same(read_topography(path, crop=(0, 2.9e-6, 0, 9e-6)), Z[:1])  # to whole pixels
    same(read_topography(path, transpose=True, crop=(3e-6, 9e-6, 0, 4e-6)), Z[:, 1:].T, PIXEL[::-1])
    assert not any(read_topography(path, periodic=(True, True), crop=(0, 2e-6, 0, 3e-6)).periodic)
    for crop in (
        (0, 4e-6, 3e-6, 11e-6),
        (2e-6, 2e-6, 0, 9e-6),
        (0, 1, 2),
        "abcd",
        (0, np.nan, 0, 1),
    ):
        with pytest.raises(InputError, match="crop: given"):
            read_topography(path, crop=crop)


def test_channels_by_name(tmp_path, monkeypatch):
    surfaces = pytest.importorskip(
        "SurfaceTopography", reason="the extra femseal[surface] is not installed"
    )

    class Channel:
        dim, is_height_channel, nb_grid_pts = 2, True, (2, 3)

        def __init__(self, name, factor, height=True):
            self.name, self.is_height_channel, self.factor = name, height, factor
            self.physical_sizes = (4e-6, 9e-6)

        def topography(self):
            return surfaces.Topography(
                np.nan_to_num(Z) * self.factor, self.physical_sizes, unit="m"
            )

    class File:
        channels = (
            Channel("Height", 1),
            Channel("Phase", 1, height=False),
            Channel("Back", 2),
            Channel("Back", 3),
        )

    monkeypatch.setattr(surfaces, "open_topography", lambda path: File)
    path = write(tmp_path, "face.xyz9", "x")
    same(read_topography(path, channel="Height"), np.nan_to_num(Z))
    same(read_topography(path, channel=2), 2 * np.nan_to_num(Z))
    listed = r"0 to 3, it has 4 channels: 0 \(Height\), 1 \(Phase\), 2 \(Back\), 3 \(Back\)"
    for wrong in (4, -1, "Front", "Back"):
        with pytest.raises(InputError, match=f"channel={wrong!r}, expected {listed}"):
            read_topography(path, channel=wrong)
    with pytest.raises(
        InputError, match=r"channel=Phase \(Phase\), .* a map of heights: 0 \(Height\), 2 \(Back\)"
    ):
        read_topography(path, channel="Phase")


def test_text_exports_lie_as_the_file_of_the_instrument(tmp_path):
    """As Gwyddion writes text: lines of x from the first y on, sides with their unit."""
    whole = np.random.default_rng(1).normal(0, 1e-6, (30, 40))
    face = read_topography(write(tmp_path, "face.sur", WRITERS[".sur"](whole, PIXEL)))
    (l1, l2), z = face.size, face.heights
    for decimal in ".,":
        lines = ["\t".join(f"{v:.17g}".replace(".", decimal) for v in line) for line in z.T]
        head = f"# Width: {l1 * 1e3:.12g} mm\n# Height: {l2 * 1e3:.12g} mm\n# Value units: m\n"
        text = head.replace(".", decimal) + "\n".join(lines)
        same(read_topography(write(tmp_path, "face.txt", text)), z, face.spacing, rtol=1e-15)


# --- what the caller gets wrong ---------------------------------------------------------------------------


def test_no_file(tmp_path):
    with pytest.raises(
        InputError, match=r"none\.npy: given no such file, expected a file with heights"
    ):
        read_topography(tmp_path / "none.npy")
    with pytest.raises(InputError, match="given a folder"):
        read_topography(tmp_path)


def test_missing_or_doubled_size(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z)
    with pytest.raises(
        InputError,
        match=r"no pixel size in the file \(2 × 3 points\), expected two lengths in size= or spacing=",
    ):
        read_topography(path)
    with pytest.raises(InputError, match="size, spacing: given both, expected one of the two"):
        read_topography(path, size=(1, 1), spacing=PIXEL)
    with pytest.raises(InputError, match="spacing: given"):
        read_topography(path, spacing=(0.0, 1.0))


def test_options_of_other_formats_are_refused(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z)
    for given in ({"array": "z"}, {"delimiter": ","}, {"channel": 1}):
        with pytest.raises(InputError, match=f"{next(iter(given))}: given .* only, not face.npy"):
            read_topography(path, spacing=PIXEL, **given)


# --- files of instruments ---------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", WRITERS)
def test_files_of_instruments(tmp_path, suffix):
    """Heights, pixel, orientation and undefined points, by formats whose units differ."""
    face = read_topography(write(tmp_path, f"face{suffix}", WRITERS[suffix](Z, PIXEL)))
    same(face)


def test_a_file_of_an_instrument_in_a_wrong_channel(tmp_path):
    path = write(tmp_path, "face.plu", WRITERS[".plu"](Z, PIXEL))
    with pytest.raises(InputError, match="given channel=1, expected 0 to 0, it has 1 channels"):
        read_topography(path, channel=1)


# --- memory -----------------------------------------------------------------------------------------------

READ = """
import sys
import femseal as fs
from femseal.base.machine import peak_memory

used = []
for path in sys.argv[1:]:  # the first loads what reading takes
    fs.read_topography(path, spacing=(1e-6, 1e-6), height_unit="um")
    used.append(peak_memory())
print(used[1] - used[0])
"""


@pytest.mark.parametrize("kind", ["csv", "npy"])
def test_files_are_read_in_three_times_their_memory(tmp_path, kind):
    """A text of 40 MB by its length, a map of 4000² points by that of its heights; in a process of their own."""
    paths = [tmp_path / f"{name}.{kind}" for name in ("small", "large")]
    for path, n in zip(paths, (40, 2000 if kind == "csv" else 4000), strict=True):
        z = np.random.default_rng(0).standard_normal((n, n))
        if kind == "csv":
            path.write_text("\n".join(" ".join(f"{v:.6f}" for v in line) for line in z))
        else:
            np.save(path, z)
    size = paths[1].stat().st_size if kind == "csv" else 8 * 4000**2
    done = subprocess.run(
        [sys.executable, "-c", READ, *paths], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) < 3 * size
