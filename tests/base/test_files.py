"""Files that are whole or not there."""

import subprocess
import sys

import pytest

CODE = """
import resource, signal, sys
from pathlib import Path
import h5py, numpy as np
from femseal.base.files import replacing_hdf5
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
try:
    with replacing_hdf5(Path(sys.argv[1])) as target, h5py.File(target, "w") as file:
        for n in range(8):
            values = file.create_dataset(f"values{n}", (6, 90, 90), np.float32, chunks=(1, 30, 30), compression="gzip")
            for s in range(6):
                values[s] = np.random.default_rng(s).random((90, 90))
            assert values[0].max() > 0
except OSError as error:
    print(type(error).__name__, error.errno)
"""


@pytest.mark.parametrize("room", [1000, 300_000])
def test_a_file_for_which_there_is_no_room_is_an_error_and_not_a_crash(tmp_path, room):
    path = tmp_path / "values.h5"
    path.write_text("former")
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(path), str(room)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("OSError"), done.stdout
    assert path.read_text() == "former"
    assert [p.name for p in tmp_path.iterdir()] == ["values.h5"]
