"""Loads that several runs need for a class."""

from types import SimpleNamespace

from loaded_datasets import dataset_with_loads

from femseal.results.class_loads import common_load_text


def test_loads_of_several_runs_are_forces_where_their_scales_agree():
    def text(*all_loads):
        runs = [SimpleNamespace(dataset=dataset_with_loads(*loads)) for loads in all_loads]
        return common_load_text(runs)(1e8)

    forces = ("1000.0 N", "2000.0 N")
    assert text(forces, ("1000.0 N", "2000.2 N")) == "2 kN (100 MPa)"
    for other in (("1000.0 N", "2010.0 N"), ("1000.0 N/m", "2000.0 N/m"), (5e7, 1e8)):
        assert text(forces, other) == "100 MPa"
