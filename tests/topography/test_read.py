"""Readers: files made here, in every format."""

import os
import subprocess
import sys
import zipfile
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
import sdfio
import x3pio
from instrument_files import WRITERS
from numpy.testing import assert_allclose
from PIL import Image

from femseal.base import InputError
from femseal.topography import read_for_a_look, read_topography

Z = np.array([[1.0, 2.0, np.nan], [4.0, -5.0, 6.5]]) * 1e-6
PIXEL = (2e-6, 3e-6)
MASK = np.array([[False, True, False], [True, False, False]])  # of Z, x first
#: What corrects a file that says otherwise.
SIZED, SPACED, MICRON = {"size": (4e-6, 9e-6)}, {"spacing": PIXEL}, {"height_unit": "um"}


def same(face, heights=Z, spacing=PIXEL, rtol=1e-6):
    assert_allclose(face.heights, heights, rtol=rtol)
    assert_allclose(face.spacing, spacing)


def write(folder, name, text):
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


# --- NumPy ------------------------------------------------------------------------------------------------


def refused(said, path, **given):
    with pytest.raises(InputError, match=said) as error:
        read_topography(path, **given)
    assert "\n" not in str(error.value)


def stored(folder, z=Z, spacing=PIXEL, **more):
    """A file of an array and its pixel."""
    path = folder / "face.npz"
    np.savez(path, z=z, spacing=spacing, **more)
    return path


def test_npy_files_are_read_with_the_spacing_of_the_caller(tmp_path):
    path = tmp_path / "face.npy"
    np.save(path, Z)
    same(read_topography(path, spacing=PIXEL))
    same(read_topography(str(path), size=(4e-6, 9e-6)))
    assert read_topography(path, spacing=PIXEL).periodic == (False, False)
    assert read_topography(path, spacing=PIXEL, periodic=(False, True)).periodic == (False, True)
    np.save(path, Z * 1e9)
    same(read_topography(path, spacing=PIXEL, height_unit="nm"))
    np.save(path, np.array([[1, 2], [3, 4]], dtype=np.int16))
    same(read_topography(path, spacing=PIXEL, height_unit="um"), [[1e-6, 2e-6], [3e-6, 4e-6]])
    np.save(path, Z * 1e6)
    refused("expected at most 10 mm", path, spacing=PIXEL)
    same(read_topography(path, spacing=PIXEL, height_unit="m"), Z * 1e6)


def test_npz_files_are_read_with_their_spacing_and_mask(tmp_path):
    path = tmp_path / "face.npz"
    np.savez(path, only=Z)
    same(read_topography(path, spacing=PIXEL))
    np.savez(path, a=Z, b=2 * Z, spacing=PIXEL)
    same(read_topography(path, array="b"), 2 * Z)
    same(read_topography(path, array="a", spacing=(1e-6, 1e-6)), spacing=(1e-6, 1e-6))
    refused(
        "given array=None of the arrays a, b, expected a file with one map, or the name of the map in array=",
        path,
    )
    refused("given array='c' of the arrays a, b, expected a file with one map", path, array="c")
    same(read_topography(stored(tmp_path, step=3, name="loading")))
    refused(r"a spacing of shape \(\)", stored(tmp_path, spacing=1e-6))
    stored(tmp_path, mask=MASK)
    same(read_topography(path), masked())
    same(read_topography(path, file_mask=False))
    refused(r"given an array mask of bool of shape \(3, 2\)", stored(tmp_path, mask=MASK.T))


def test_a_part_of_a_map_and_its_transposed_refer_to_the_result(tmp_path):
    path = stored(tmp_path)
    same(read_topography(path, transpose=True), Z.T, PIXEL[::-1])
    same(read_topography(path, transpose=True, spacing=(1e-6, 5e-6)), Z.T, (1e-6, 5e-6))
    same(read_topography(path, transpose=True, size=(6e-6, 8e-6)), Z.T, (2e-6, 4e-6))
    same(read_topography(path, crop=(0, 4e-6, 3e-6, 9e-6)), Z[:, 1:])
    same(read_topography(path, crop=(0, 2.9e-6, 0, 9e-6)), Z[:1])  # to whole pixels
    same(read_topography(path, transpose=True, crop=(3e-6, 9e-6, 0, 4e-6)), Z[:, 1:].T, PIXEL[::-1])
    assert not any(read_topography(path, periodic=(True, True), crop=(0, 2e-6, 0, 3e-6)).periodic)
    ends = ((0, 4e-6, 3e-6, 11e-6), (2e-6, 2e-6, 0, 9e-6), (0, 1, 2), "abcd", (0, np.nan, 0, 1))
    for crop in ends:
        refused("crop: given", path, crop=crop)


@pytest.mark.parametrize(
    "array", [np.zeros(4), np.zeros((2, 2, 2)), np.zeros((0, 2)), np.full((2, 2), "a")]
)
def test_arrays_that_are_not_a_map_are_refused(tmp_path, array):
    np.save(tmp_path / "face.npy", array)
    said = r"face\.npy: given an array of .* real numbers of shape \(n1, n2\)"
    refused(said, tmp_path / "face.npy", spacing=PIXEL)


# --- text -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", "   ", ", "])
@pytest.mark.parametrize("suffix", [".csv", ".asc", ".TXT"])
def test_text_delimiters_are_found(tmp_path, delimiter, suffix):
    lines = [delimiter.join(f"{v!r}" for v in row) + "\r\n" for row in Z.tolist()]
    path = write(tmp_path, f"face{suffix}", "# measured\n\n" + "".join(lines))
    same(read_topography(path, spacing=PIXEL), Z.T)


def test_a_given_delimiter_is_used(tmp_path):
    path = write(tmp_path, "face.txt", "1e-6|2e-6\n3e-6|4e-6\n")
    same(read_topography(path, spacing=PIXEL, delimiter="|"), [[1e-6, 3e-6], [2e-6, 4e-6]])


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
def test_words_for_undefined_points_in_texts_are_recognised(tmp_path, text):
    same(read_topography(write(tmp_path, "face.csv", text), spacing=PIXEL), Z.T)


def test_sides_and_unit_are_read_from_the_header_of_a_text(tmp_path):
    """x of the file is x1: one line for each y."""
    text = "# Channel: height\n# Width: 9 um\n# Height: 4 µm\n# Value units: nm\n1 2 3\n4 5 6\n"
    path = write(tmp_path, "face.txt", text)
    lines = np.arange(1, 7).reshape(2, 3).T
    same(read_topography(path), lines * 1e-9, (3e-6, 2e-6))
    same(read_topography(path, transpose=True), lines.T * 1e-9)
    same(read_topography(path, spacing=(1, 1), height_unit="um"), lines * 1e-6, (1, 1))


@pytest.mark.parametrize("delimiter", [";", "\t", " "])
def test_decimal_commas_are_recognised(tmp_path, delimiter):
    text = "# Width: 9,0 um\n# Height: 4,0 µm\n# Value units: nm\n"
    text += "\n".join(delimiter.join(f"{v},5" for v in line) for line in ((1, 2, 3), (4, 5, 6)))
    heights = (np.arange(1, 7) + 0.5).reshape(2, 3).T * 1e-9
    same(read_topography(write(tmp_path, "face.txt", text)), heights, (3e-6, 2e-6))


def test_coordinates_in_any_order_form_a_grid(tmp_path):
    rng = np.random.default_rng(0)
    z = rng.standard_normal((4, 5)) * 1e-6
    z[1, 2] = np.nan
    i, j = (n.ravel() for n in np.indices(z.shape))
    order = rng.permutation(z.size)
    lines = [f"{1e-3 + 3e-6 * i[n]:.12g}, {2e-6 * j[n]:.12g}, {z[i[n], j[n]]:.12g}" for n in order]
    same(read_topography(write(tmp_path, "face.csv", "\n".join(lines))), z, (3e-6, 2e-6))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n3\n", "given 1 number in line 2 after 2 in line 1"),
        ("1;2\n3;x4\n", "given 'x4' in line 2, expected numbers with a decimal point"),
        ("1.5;2,5\n", "given '2,5' in line 1"),
        ("1,5;2,5,1\n", "given '2,5,1' in line 1"),
        ("1e-6|2e-6\n3e-6|4e-6\n", r"'1e-6\|2e-6' in line 1"),
        ("# nothing\n", "given no line with numbers"),
        ("", "given no line with numbers"),
        (bytes(range(256)), "a file that is not a text"),
        ("1 inf\n2 3\n", r"face\.asc: heights: given 1 point not finite"),
        ("a = 1 mm\n1 2\n3 4\nend\n", "given 'end' in line 4, .* put # before other lines"),
    ],
)
def test_faulty_texts_are_refused_with_the_line(tmp_path, text, message):
    refused(message, write(tmp_path, "face.asc", text), spacing=PIXEL)


# --- instrument formats -----------------------------------------------------------------------------------


def test_x3p_files_are_read_as_they_were_written(tmp_path):
    path = tmp_path / "face.x3p"
    x3pio.write(path, Z.T, x_scale=PIXEL[0], y_scale=PIXEL[1])  # rows of the format are y
    same(read_topography(path))
    x3pio.write(path, np.stack([Z.T, 2 * Z.T]), x_scale=PIXEL[0], y_scale=PIXEL[1])
    same(read_topography(path, channel=1), 2 * Z)
    refused("given channel=2, expected 0 to 1, it has 2 layers", path, channel=2)
    x3pio.write(path, Z[1], x_scale=1e-6)
    refused("given a profile of 3 points .*, expected a map", path)


def test_x3p_agrees_with_an_independent_reader(tmp_path):
    independent = pytest.importorskip("SurfaceTopography").read_topography
    path = tmp_path / "face.x3p"
    z = np.random.default_rng(0).standard_normal((7, 5)) * 1e-6
    x3pio.write(path, z.T, x_scale=PIXEL[0], y_scale=PIXEL[1])
    x3pio.read(path).with_revision(x3pio.Revision.ISO5436_2000, drop_extensions=True).save(path)
    same(read_topography(path), independent(str(path)).heights(), rtol=1e-12)


@pytest.mark.parametrize("kind", ["ASCII", "BINARY"])
def test_sdf_files_are_read_as_they_were_written(tmp_path, kind):
    path = tmp_path / "face.sdf"
    sdfio.write(path, Z.T, x_scale=PIXEL[0], y_scale=PIXEL[1], format=sdfio.FileFormat[kind])
    same(read_topography(path))
    refused("given channel=1", path, channel=1)


def test_sdf_written_by_hand_in_micrometres_is_refused_and_corrected(tmp_path):
    text = (
        "aISO-1.0\r\nManufacID = hand\r\nCreateDate = 010120200000\r\nModDate = 010120200000\r\n"
        "NumPoints = 3\r\nNumProfiles = 2\r\nXscale = 2\r\nYscale = 3\r\nZscale = 1\r\nZresolution = -1\r\n"
        "Compression = 0\r\nDataType = 7\r\nCheckType = 0\r\n*\r\n1.0 2.0 3.0\r\n4.0 5.0 7.0\r\n*\r\n*\r\n"
    )
    path = write(tmp_path, "face.sdf", text)
    refused(r"given a size of 6 m × 6 m, expected 1 nm to 1 m; .* pass size=", path)
    too_high = r"given Sq = 1\.972 m, expected at most 10 mm; .* pass height_unit="
    refused(too_high, path, spacing=PIXEL)
    corrected = read_topography(path, spacing=PIXEL, height_unit="um")
    same(corrected, np.array([[1.0, 4.0], [2.0, 5.0], [3.0, 7.0]]) * 1e-6)


@pytest.mark.parametrize("kind", ["npy", "npz", "packed.npz", "csv", "x3p", "a.sdf", "b.sdf"])
def test_a_damaged_file_raises_an_input_error_and_no_other(tmp_path, kind):
    """A file with a wrong byte is read, or refused with its name."""
    path, z = tmp_path / f"face.{kind}", np.arange(20.0).reshape(4, 5) * 1e-7
    pixel = {"x_scale": 1e-6, "y_scale": 1e-6}
    ascii_, binary = sdfio.FileFormat.ASCII, sdfio.FileFormat.BINARY
    {
        "npy": partial(np.save, path, z),
        "npz": partial(np.savez, path, heights=z, spacing=PIXEL),
        "packed.npz": partial(np.savez_compressed, path, heights=z, spacing=PIXEL),
        "csv": partial(np.savetxt, path, z, "%g", ";", header="Width: 1 mm\nHeight: 2 mm"),
        "x3p": partial(x3pio.write, path, z, **pixel),
        "a.sdf": partial(sdfio.write, path, z, **pixel, format=ascii_),
        "b.sdf": partial(sdfio.write, path, z, **pixel, format=binary),
    }[kind]()
    whole, refused = path.read_bytes(), 0
    for at in range(0, len(whole), 1 + len(whole) // 200):
        for byte in (0, 255, ord("("), ord("n"), whole[at] ^ 1):
            path.write_bytes(whole[:at] + bytes([byte]) + whole[at + 1 :])
            try:
                read_topography(path, spacing=PIXEL)
            except InputError:
                refused += 1
    assert refused > 0


def test_formats_of_instruments_need_an_optional_package(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "SurfaceTopography", None)
    said = r"a file of kind '\.opd', .* pip install 'femseal\[surface\]'"
    refused(said, write(tmp_path, "face.opd", b"x"))


def test_output_of_readers_about_damaged_files_is_suppressed(tmp_path, monkeypatch, capfd):
    def printing(path):
        print("bytes of the file")
        print("and more of them", file=sys.stderr)
        raise ValueError

    library = type(sys)("SurfaceTopography")
    library.open_topography = printing
    monkeypatch.setitem(sys.modules, "SurfaceTopography", library)
    with pytest.raises(InputError, match="formats known to SurfaceTopography"):
        read_topography(write(tmp_path, "face.opd", b"x"))
    print("later")
    os.write(2, b"later too")
    assert capfd.readouterr() == ("later\n", "later too")


def test_an_unknown_format_is_refused(tmp_path):
    pytest.importorskip("SurfaceTopography")
    said = r"face\.xyw: given .*, expected a file of one of the formats .* \.plu .* export \.x3p"
    refused(said, write(tmp_path, "face.xyw", b"\x00\x01no such format"))


@pytest.mark.parametrize(
    ("heights", "spacing", "message", "correction"),
    [
        (Z, (80.0, 60.0), r"a size of 160 m × 180 m, .* pass size= \(--size\)", SIZED),
        (Z, (1e-12, 1e-6), r"a size of 2 pm × 3 µm, .* pass size= \(--size\)", SPACED),
        (Z, (0.0, 1e-6), r"a pixel of 0 m × 1e-06 m, .* pass spacing= or size=", SPACED),
        (Z, (-1e-6, 1e-6), r"a pixel of -1e-06 m × 1e-06 m, .* two lengths > 0", SIZED),
        (Z, (np.nan, 1e-6), r"a pixel of nan m", SIZED),
        (Z / 4e-6, (0.2, 0.2), r"Sq = 9\d+\.\d mm, .* pass height_unit= such as 'um'", MICRON),
        (Z * 100, PIXEL, r"a median slope of \d+, .* \(--size, --height-u", MICRON),
        (Z * 100, PIXEL, "a median slope of", {"spacing": (2e-4, 3e-4)}),
        (Z * 100, PIXEL, "a median slope of", SPACED | {"height_unit": "m"}),
    ],
)
def test_implausible_units_are_refused_with_advice(tmp_path, heights, spacing, message, correction):
    path = stored(tmp_path, heights, spacing)
    refused(message, path)
    read_topography(path, **correction)


def test_large_pixels_and_spikes_are_not_taken_for_a_wrong_unit(tmp_path):
    assert read_topography(stored(tmp_path, spacing=(0.25, 0.2))).spacing == (0.25, 0.2)
    z = np.zeros((50, 50))
    z[::5, ::5] = 1e-3
    assert read_topography(stored(tmp_path, z)).rms_slope > 10


# --- masks and parts --------------------------------------------------------------------------------------


def masked(heights=Z, mask=MASK):
    return np.where(mask, np.nan, heights)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".gif", ".npy", ".csv", ".txt"])
def test_points_are_masked_by_a_file(tmp_path, suffix):
    """A line of an image or a text runs along the file's x; an array lies as those of NumPy."""
    path, mask = stored(tmp_path), tmp_path / f"mask{suffix}"
    if suffix == ".npy":
        np.save(mask, MASK)
    elif suffix in (".csv", ".txt"):
        np.savetxt(mask, MASK.T, "%d")
    else:
        Image.fromarray((MASK.T * 255).astype(np.uint8)).save(mask)
    same(read_topography(path, mask=mask), masked())
    same(read_topography(path, mask=mask, transpose=True), masked().T, PIXEL[::-1])


@pytest.mark.parametrize("mode", ["1", "RGB", "RGBA", "P", "I;16"])
def test_images_of_every_kind_mask_where_they_are_not_black(tmp_path, mode):
    if mode == "I;16":
        image = Image.fromarray(MASK.T.astype(np.uint16) * 300)
    else:
        image = Image.fromarray((MASK.T * 255).astype(np.uint8)).convert(mode)
    image.save(tmp_path / "mask.png")
    same(read_topography(stored(tmp_path), mask=tmp_path / "mask.png"), masked())


def test_masks_of_another_size_are_refused(tmp_path):
    path = stored(tmp_path)
    for name in ("mask.jpg", "bad.png", "bad.npy"):
        write(tmp_path, name, "no mask")
    np.save(tmp_path / "mask.npy", MASK.T)
    for name, said in {
        "mask.npy": r"mask: given 3 × 2 points in 'mask.npy', expected 2 × 3, .* transpose would fit",
        "none.png": r"mask: given '.*none.png', no such file",
        "mask.jpg": r"mask: given 'mask.jpg', expected a file \.png, ",
        "bad.png": r"bad.png: given .*, expected a file that can be read",
        "bad.npy": r"bad.npy: given .*, expected an intact \.npy file",
    }.items():
        refused(said, path, mask=tmp_path / name)


def test_the_mask_of_a_gwyddion_file_is_applied(tmp_path):
    """Its points are undefined, or have their heights; a second mask comes on top."""
    surfaces = pytest.importorskip("SurfaceTopography")
    z = np.nan_to_num(Z) * 1e6 + 1
    path = tmp_path / "face.gwy"
    surfaces.Topography(np.ma.masked_array(z, MASK), (4.0, 9.0), unit="µm").to_gwy(str(path))
    # the writer puts 0 under the mask, and the library scales only what is not masked
    content, heights = path.read_bytes(), (z * 1e-6).T.astype("<f8").tobytes()
    holed = np.where(MASK, 0, z * 1e-6).T.astype("<f8").tobytes()
    assert content.count(holed) == 1
    path.write_bytes(content.replace(holed, heights))
    same(read_topography(path), masked(z * 1e-6))
    same(read_topography(path, file_mask=False), z * 1e-6)
    np.save(tmp_path / "mask.npy", ~MASK)
    assert read_topography(path, mask=tmp_path / "mask.npy").undefined_fraction == 1
    said = r"file_mask: given False, expected for \.gwy, \.npz files only"
    refused(said, tmp_path / "mask.npy", file_mask=False)


def test_channels_are_selected_by_name(tmp_path, monkeypatch):
    surfaces = pytest.importorskip("SurfaceTopography")
    z = np.nan_to_num(Z)

    def channel(name, factor, height=True):
        face = surfaces.Topography(z * factor, (4e-6, 9e-6), unit="m")
        shape = {"dim": 2, "nb_grid_pts": (2, 3), "physical_sizes": (4e-6, 9e-6)}
        given = {"name": name, "is_height_channel": height, "topography": lambda: face}
        return SimpleNamespace(**shape, **given)

    channels = [channel("Height", 1), channel("Phase", 1, False), channel("Back", 2)]
    file = SimpleNamespace(channels=[*channels, channel("Back", 3)])
    monkeypatch.setattr(surfaces, "open_topography", lambda path: file)
    path = write(tmp_path, "face.xyz9", "x")
    same(read_topography(path, channel="Height"), z)
    same(read_topography(path, channel=2), 2 * z)
    listed = r"0 to 3, it has 4 channels: 0 \(Height\), 1 \(Phase\), 2 \(Back\), 3 \(Back\)"
    for wrong in (4, -1, "Front", "Back"):
        refused(f"channel={wrong!r}, expected {listed}", path, channel=wrong)
    refused(r"channel=Phase \(Phase\), .* a map of heights: 0 \(H", path, channel="Phase")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, r"no pixel size in the file \(2 × 3 points\), expected two lengths in size= or s"),
        ({"size": (1, 1), "spacing": PIXEL}, "size, spacing: given both, expected one of the two"),
        ({"spacing": (0.0, 1.0)}, "spacing: given"),
        ({"height_unit": "parsnips-ish", "spacing": PIXEL}, "given '1 parsnips-ish'"),
        ({"array": "z", "spacing": PIXEL}, "array: given .* only, not face.npy"),
        ({"delimiter": ",", "spacing": PIXEL}, "delimiter: given .* only, not face.npy"),
        ({"channel": 1, "spacing": PIXEL}, "channel: given .* only, not face.npy"),
    ],
)
def test_options_that_do_not_apply_to_the_file_are_refused(tmp_path, given, said):
    np.save(tmp_path / "face.npy", Z)
    refused(said, tmp_path / "face.npy", **given)


# --- what the caller gets wrong ---------------------------------------------------------------------------


def test_a_missing_file_is_refused(tmp_path):
    refused(r"none\.npy: given no such file, expected a file with he", tmp_path / "none.npy")
    refused("given a folder", tmp_path)


# --- files of instruments ---------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", WRITERS)
def test_files_of_instruments_are_read(tmp_path, suffix):
    """Heights, pixel, orientation and undefined points, by formats whose units differ."""
    path = write(tmp_path, f"face{suffix}", WRITERS[suffix](Z, PIXEL))
    same(read_topography(path))
    refused("given channel=1, expected 0, the only channel of the file", path, channel=1)


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
@pytest.mark.slow
def test_files_are_read_in_three_times_their_memory(tmp_path, kind):
    """A text of 36 MB by its length, a map of 4000² points by that of its heights; in a process of their own."""
    paths = [tmp_path / f"{name}.{kind}" for name in ("small", "large")]
    for path, n in zip(paths, (40, 2000 if kind == "csv" else 4000), strict=True):
        if kind == "csv":
            path.write_text((" ".join(["0.123456"] * n) + "\n") * n)
        else:
            np.save(path, np.random.default_rng(0).standard_normal((n, n)))
    size = paths[1].stat().st_size if kind == "csv" else 8 * 4000**2
    command = [sys.executable, "-c", READ, *paths]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(done.stdout) < 3 * size


# --- units that the file states wrongly or not at all -------------------------------------------------------


@pytest.mark.parametrize("micron", [b"\xe6m", b"\xb5m", b"um"])
def test_micrometres_in_another_encoding_are_recognised(tmp_path, micron):
    """Programs write it in the code page of DOS, or in latin-1."""
    pytest.importorskip("SurfaceTopography")
    content = WRITERS[".sur"](Z, PIXEL).replace(b"\xb5m".ljust(16), micron.ljust(16))
    path = write(tmp_path, "face.sur", content)
    same(read_topography(path))
    found = read_for_a_look(path, height_unit="nm", spacing=(1e-6, 1e-6))
    same(found.topography, 1e-3 * Z, (1e-6, 1e-6))
    assert "height_unit nm overrides the file, which says 1 µm per number" in found.notes


def test_a_file_with_an_unknown_unit_is_refused_with_the_unit(tmp_path):
    pytest.importorskip("SurfaceTopography")
    content = WRITERS[".sur"](Z, PIXEL).replace(b"\xb5m".ljust(16), b"parsnip".ljust(16))
    path = write(tmp_path, "face.sur", content)
    refused(r"cannot be read \(ValueError: Unknown unit 'parsnip'", path)


def test_a_gwyddion_file_without_units_is_refused_with_advice(tmp_path):
    surfaces = pytest.importorskip("SurfaceTopography")
    path = tmp_path / "face.gwy"
    surfaces.Topography(np.nan_to_num(Z), (4.0, 9.0), unit="m").to_gwy(str(path))
    content = path.read_bytes()
    assert content.count(b"unitstr\0sm\0") >= 2
    path.write_bytes(content.replace(b"unitstr\0sm\0", b"unitstr\0s1\0"))
    said = "no channel of the file has a unit of length, .* set the units of the heights and of the lateral"
    refused(said, path, height_unit="um")


def test_a_channel_that_is_no_height_is_read_in_the_unit_of_the_caller(tmp_path, monkeypatch):
    surfaces = pytest.importorskip("SurfaceTopography")
    z = np.nan_to_num(Z) * 1e6
    face = surfaces.Topography(z, (4.0, 9.0), unit="µm")
    shape = {"dim": 2, "nb_grid_pts": (2, 3), "physical_sizes": (4.0, 9.0), "data_unit": "deg"}
    given = {"name": "Phase", "is_height_channel": False, "topography": lambda: face}
    file = SimpleNamespace(channels=[SimpleNamespace(**shape, **given)])
    monkeypatch.setattr(surfaces, "open_topography", lambda path: file)
    path = write(tmp_path, "face.xyz9", "x")
    refused(
        "Phase., which is not a map of heights but is in 'deg', .* none in this file; if its numbers",
        path,
    )
    found = read_for_a_look(path, height_unit="nm")
    same(found.topography, z * 1e-9)
    assert "height_unit nm is used; the file has the unit 'deg' of the channel" in found.notes[0]
    file.channels = []
    refused("no channel of the file has a unit of length", path)


def test_an_x3p_with_a_wrong_checksum_is_read_on_request(tmp_path):
    path = tmp_path / "face.x3p"
    x3pio.write(path, Z.T, x_scale=PIXEL[0], y_scale=PIXEL[1])
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content + b" " * (name == "main.xml"))
    refused("changed or damaged after it was written .*--no-verify-checksum", path)
    found = read_for_a_look(path, verify_checksum=False)
    same(found.topography)
    assert "read nevertheless" in found.notes[0]
    refused(
        "verify_checksum: given False, expected for .x3p files",
        stored(tmp_path),
        verify_checksum=False,
    )
