"""Ranks of several runs: those that the 95 % intervals allow, and which runs cannot be told apart."""

from dataclasses import replace

import numpy as np
from small_cases import steel_scene

import femseal as fs
from femseal.budget import ErrorBudget, ErrorPart
from femseal.results import RunFacts, assemble, compare
from femseal.results.ranking import Ranking, RankRange


def ranking(leakage, factor, has_intervals=True):
    q = np.array(leakage, float)
    return Ranking("100 MPa", "abcdef"[: q.size], q, q / factor, q * factor, has_intervals)


def test_ranks_are_those_that_the_intervals_allow():
    """Of 1, 2 and 100 within a factor of 3, the first two may change places, and the third is the last for sure."""
    found = ranking([100.0, 2.0, 1.0], 3.0)
    assert found.ranks() == [RankRange(3, 3), RankRange(1, 2), RankRange(1, 2)]
    assert [str(rank) for rank in found.ranks()] == ["3", "1–2", "1–2"]
    assert "c leaks least" in found.sentence()
    assert "overlaps with that of b" in found.sentence()
    # any order of the true leakages that the intervals allow gives ranks within these ranges
    rng = np.random.default_rng(1)
    for _ in range(50):
        true = np.exp(rng.uniform(np.log(found.lower), np.log(found.upper)))
        for rank, allowed in zip(true.argsort().argsort() + 1, found.ranks(), strict=True):
            assert allowed.best <= rank <= allowed.worst
    certain = ranking([1.0, 20.0, 400.0], 3.0)
    assert [str(rank) for rank in certain.ranks()] == ["1", "2", "3"]
    assert "whole 95 % intervals" in certain.sentence()
    assert "not known whether" in ranking([1.0, 2.0], 1.0, False).sentence()
    failed = ranking([np.nan, 2.0, 1.0], 3.0)
    assert failed.ranks()[0] is None
    assert failed.ranks()[1] == RankRange(1, 2)


def test_a_comparison_says_which_runs_cannot_be_told_apart():
    face = fs.self_affine((32, 32), (4e-5, 4e-5), hurst=0.8, rms_slope=0.2, cut_off=1e-5, rng=1)
    scene = steel_scene(face, loading=(5e7, 1e8))
    study = fs.deterministic(scene)

    def run(factor):
        leakage = factor * np.array([1e-6, 1e-7])
        part = ErrorPart("patch", leakage / 2, leakage * 2, "by hand")
        budget = ErrorBudget("deterministic", leakage, (part,), scene.steps)
        facts = RunFacts(budgets={"deterministic": budget})
        return assemble(scene, replace(study, leakage=leakage), facts=facts)

    table = compare({"smooth": run(1.0), "turned": run(2.0), "blasted": run(100.0)}).table()
    assert table.heads[-1] == "rank at 100 MPa"
    assert [line[-1] for line in table.lines] == ["1–2", "1–2", "3"]
    (note,) = table.notes
    assert "smooth leaks least" in note
    assert "overlaps with that of turned" in note
    assert "blasted" not in note


def test_a_comparison_gives_the_force_from_which_on_each_run_meets_a_class():
    """ln(leakage) is linear in ln(load): 10⁻⁶ m²/s at 1 kN and 10⁻⁷ m²/s at 2 kN, so 10⁻⁶·⁵ m²/s need √2 kN."""
    face = fs.self_affine((32, 32), (4e-5, 4e-5), hurst=0.8, rms_slope=0.2, cut_off=1e-5, rng=1)
    scene = steel_scene(face, loading=(5e7, 1e8))
    study = fs.deterministic(scene)
    limit = f"{1e3 * 10**-6.5:.6g} L/(m*s)"

    def run(factor, forces):
        leakage = factor * np.array([1e-6, 1e-7])
        part = ErrorPart("patch", leakage / 2, leakage * 2, "by hand")
        budget = ErrorBudget("deterministic", leakage, (part,), scene.steps)
        case = {"load": {"loading": forces}}
        facts = RunFacts(budgets={"deterministic": budget}, case=case, classes=[limit])
        return assemble(scene, replace(study, leakage=leakage), facts=facts)

    forces = ["1000.0 N", "2000.0 N"]
    table = compare({"smooth": run(1.0, forces), "rough": run(100.0, forces)}).table()
    _, computed, interval, *leakages, _ = zip(*table.lines, strict=True)
    assert computed[0] == "from 1.41 kN on"
    # the upper end leaks twice as much: log₁₀ 2 further along a slope of -1 for each factor of 2
    assert interval[0] == f"from {2 ** (0.5 + np.log10(2)):.3g} kN on"
    assert computed[1] == interval[1] == "at no load up to 2 kN"
    assert len(leakages) == 2
    assert table.heads[3] == "1 kN (50 MPa)"
    assert table.heads[-1] == "rank at 2 kN (100 MPa)"
    # of other areas, only the pressures can be compared
    smaller = compare({"a": run(1.0, forces), "b": run(1.0, ["500.0 N", "1000.0 N"])}).table()
    assert smaller.heads[-1] == "rank at 100 MPa"
    assert smaller.lines[1][1] == "from 0.707 kN on"


def test_the_load_of_the_rank_is_among_the_columns():
    face = fs.self_affine((32, 32), (4e-5, 4e-5), hurst=0.8, rms_slope=0.2, cut_off=1e-5, rng=1)
    scene = steel_scene(face, loading=(5e7, 1e8, 2e8, 3e8, 4e8))
    study = fs.deterministic(scene)
    runs = [
        assemble(scene, replace(study, leakage=factor * np.array([1e-6, 1e-7, 1e-8, 1e-9, 0.0])))
        for factor in (1.0, 2.0)
    ]
    heads = compare(dict(zip("ab", runs, strict=True))).table().heads
    assert heads[-1] == "rank at 300 MPa"
    assert "300 MPa" in heads
