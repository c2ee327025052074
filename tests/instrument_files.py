"""Writers of small files as instruments write them: Sensofar .plu, Digital Surf .sur, Wyko .opd.

Heights (n1, n2) [m], NaN where undefined; pixel [m]. The layouts follow the public descriptions in
Gwyddion and SurfaceTopography; what readers do not need is zero.
"""

import struct

import numpy as np


def plu(heights, spacing):
    """Micrometres in single precision, lines of x, undefined points as 1000001."""
    n1, n2 = heights.shape
    d1, d2 = (1e6 * d for d in spacing)
    z = np.where(np.isnan(heights), 1000001, 1e6 * heights).T.astype("<f4")
    date = b"Mon Jan 02 10:00:00 2017".ljust(128, b"\0") + struct.pack("<I", 0) + bytes(256)
    calibration = struct.pack("<3I7f", n2, n1, 1, 1.0, d1, d2, 0.0, 0.0, 1.0, 0.0)
    measurement = struct.pack("<5I", 3, 0, 0, 0, 0)  # a topography
    scan = struct.pack("<5IdfII", n2, n1, n2, n1, n1 * n2, 0.0, 0.0, 1, 0)
    layers = struct.pack("<5B3BI", 0, 1, 0, 0, 0, 0, 0, 0, 1)
    ends = struct.pack("<2f", 1e6 * np.nanmin(heights), 1e6 * np.nanmax(heights))
    whole = (date, calibration, measurement, scan, layers, struct.pack("<2I", n2, n1))
    return b"".join((*whole, z.tobytes(), ends))


def sur(heights, spacing, step=1e-3):
    """Whole steps of a nanometre in 32 bits over a pixel in millimetres, undefined ones lowest − 2."""
    n1, n2 = heights.shape
    steps = np.round(1e6 * heights / step)
    low, high = int(np.nanmin(steps)), int(np.nanmax(steps))
    z = np.where(np.isnan(steps), low - 2, steps).T.astype("<i4")
    text = b"".join(word.ljust(16) for word in (b"X", b"Y", b"Z", *([b"mm", b"mm", b"\xb5m"] * 2)))
    parts = (
        b"DIGITAL SURF" + struct.pack("<4H", 0, 1, 210, 2),
        b"face".ljust(30) + b"instrument".ljust(30),
        struct.pack("<5H2IH", 0, 0, 0, 1, 1, 0, 0, 32),
        struct.pack("<4iI", low, high, n1, n2, n1 * n2),
        struct.pack("<3f", 1e3 * spacing[0], 1e3 * spacing[1], step),
        text + struct.pack("<3f", 1, 1, 1),
        struct.pack("<3H3I", 0, 0, 0, 0, 0, 0),
        struct.pack("<7Hf2I3H", 0, 0, 10, 2, 1, 2017, 0, 0.0, 0, 0, 0, 0, 0),
        bytes(128) + bytes(12) + bytes(34),
    )
    return b"".join(parts) + z.tobytes()


def opd(heights, spacing, wavelength=600.0):
    """Waves in single precision, columns of y from the last to the first, the pixel in millimetres."""
    waves = heights[:, ::-1] * 1e9 / wavelength
    z = np.where(np.isnan(waves), 2e38, waves).astype("<f4")
    raster = struct.pack("<3H", *heights.shape, 4) + z.tobytes()
    numbers = {"Wavelength": wavelength, "Aspect": spacing[1] / spacing[0]}
    numbers["Pixel_size"] = 1e3 * spacing[0]
    blocks = [("RAW_DATA", 3, raster)]
    blocks += [(name, 7, struct.pack("<f", value)) for name, value in numbers.items()]
    head = [("Directory", 1, bytes(24 * (len(blocks) + 1)))]
    entries = (
        struct.pack("<16shlH", name.encode(), kind, len(content), 0)
        for name, kind, content in head + blocks
    )
    return b"\1\0" + b"".join(entries) + b"".join(content for _, _, content in blocks)


#: By the end of the name.
WRITERS = {".plu": plu, ".sur": sur, ".opd": opd}
