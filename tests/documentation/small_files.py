"""Small files in place of those that the documentation names: a case, a leak test of it and measured maps."""

import x3pio

import femseal as fs

#: A case of a turned face, small enough for every study, with the keys that the commands change.
TURNED_CASE = """
method = "two-scale"
seed = 1
[face]
kind = "turned"
points = [64, 128]
size = ["80 um", "160 um"]
pitch = "40 um"
depth = "1 um"
roughness = "1 um"
roughness_roll_off = "30 um"
[material]
young = "210 GPa"
hardness = "3 GPa"
[load]
loading = ["25 MPa", "50 MPa", "100 MPa", "150 MPa", "200 MPa", "300 MPa"]
unload_from = ["300 MPa"]
unloading = ["150 MPa", "100 MPa", "25 MPa"]
[fluid]
kind = "liquid"
viscosity = "1 mPa*s"
inlet_pressure = "0.3 MPa"
[cells]
count = [2, 4]
[output]
test_fluid = {name = "helium", inlet_pressure = "2 bar", slip = false}
"""
#: A leak test of it.
LEAK_TEST = "pressure [MPa], leakage [mg/(m·s)]\n25, 40\n50, 20\n100, 5\n200, 1\n300, < 1\n"


def write_map(path, seed):
    """A measured map of 48 × 64 µm."""
    given = {"hurst": 0.8, "rms_slope": 0.2, "roll_off": 30e-6, "rng": seed}
    face = fs.self_affine((48, 64), (48e-6, 64e-6), **given)
    scales = {"x_scale": 1e-6, "y_scale": 1e-6, "z_scale": 1e-9}
    x3pio.write(path, face.heights.T, **scales, z_type=x3pio.DataType.INT16)
