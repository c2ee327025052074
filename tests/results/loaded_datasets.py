"""Datasets of results that know their loads and nothing else."""

import json

import numpy as np
import xarray


def dataset_with_loads(*loads, pressures=(5e7, 1e8)):
    """A dataset whose case gives these loads."""
    case = json.dumps({"load": {"loading": loads}})
    nominal = ("step", np.array(pressures))
    return xarray.Dataset({"nominal_pressure": nominal}, attrs={"case": case})
