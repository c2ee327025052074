"""Samplers of links: what is drawn has the library's distribution, its correlations and its monotone histories."""

import numpy as np
import pytest
from each import each
from femseal.library import SAMPLERS, LinkTable, correlation_length, draw_links
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import spearmanr

from femseal.base.errors import InputError
from femseal.loads import LoadProgramme

STEPS = LoadProgramme.of((1e8, 2e8, 3e8), (3e8,), (2e8, 1e8))
SMOOTH = ("history", "derivative", "copula")


def histories(n=400, seed=0):
    """Monotone synthetic histories, the tightest third of them closed at the highest load: (1, cells, steps)."""
    rng = np.random.default_rng(seed)
    ln = np.cumsum(-rng.exponential(1.0, (n, 3)), axis=1)
    lowest = np.argsort(np.argsort(ln[:, 2])) < n / 3
    k = np.exp(ln) * ~(lowest[:, None] & [False, False, True])
    up = np.cumsum(rng.exponential(0.02, (n, 2)), axis=1)
    return np.concatenate([k, np.minimum(k[:, 2:] + up, k[:, 1::-1])], axis=1)[None]


def drawn(k, n, sampler, *, path=None, steps=STEPS, rows=1, run_length=0.0, **numbers):
    """Permeabilities (links, steps), links column after column, of k (paths, cells, steps)."""
    path = np.zeros(n, int) if path is None else path
    table = LinkTable(np.moveaxis(k, -1, 0), path.reshape(-1, rows).T, steps, run_length)
    draw = draw_links(table, sampler=sampler, **({"seed": 1, "realisation": 0, "axis": 0} | numbers))
    return np.stack([draw(s).T.ravel() for s in range(len(steps))], axis=1)


@pytest.mark.parametrize("sampler", SMOOTH)
class TestDistribution:
    def test_marginals_and_closed_share(self, sampler):
        """Each step's distribution is the library's: Kolmogorov-Smirnov distance and P(k = 0)."""
        k = histories()
        links = drawn(k, 20_000, sampler)
        for n in range(5):
            grid = np.quantile(k[0, :, n], np.linspace(0, 1, 200))
            ks = np.abs((links[:, n, None] <= grid).mean(axis=0) - (k[0, :, n, None] <= grid).mean(axis=0)).max()
            assert ks < (0.02 if sampler == "history" else 0.05)
        assert_allclose((links[:, 2] == 0).mean(), 1 / 3, atol=0.02)

    def test_histories_are_monotone_and_tighter_after_the_peak(self, sampler):
        links = drawn(histories(), 5000, sampler)
        assert (links >= 0).all()
        assert (np.diff(links[:, :3], axis=1) <= 1e-15).all()
        assert (np.diff(links[:, 2:], axis=1) >= -1e-15).all()
        if sampler != "derivative":
            assert (links[:, [3, 4]] <= links[:, [1, 0]] + 1e-15).all()

    def test_links_follow_their_own_path(self, sampler):
        k = np.stack([np.ones((4, 5)), np.full((4, 5), 2.0)])
        assert_allclose(drawn(k, 4, sampler, path=np.array([0, 1, 1, 0]))[:, 0], [1, 2, 2, 1])


def from_normal_numbers(n):
    """Histories whose ranks are those of correlated normal numbers, falling by decades; a quarter close at the end."""
    correlation = np.exp(-np.abs(np.subtract.outer([0, 1, 2, 1.7, 1.2], [0, 1, 2, 1.7, 1.2])) / 1.5)
    z = np.random.default_rng(2).multivariate_normal(np.zeros(5), correlation, size=n)
    k = np.exp(0.5 * z - 10 * np.array([0, 2, 4, 3, 1]))
    k[np.argsort(z[:, 2])[: n // 4], 2] = 0
    return k[None]


class TestCorrelation:
    def test_between_distant_loads(self):
        """Rank correlations of all pairs of steps: kept by whole histories and by ranks drawn together."""
        for k, samplers in ((histories(2000), ["history"]), (from_normal_numbers(2000), ["history", "copula"])):
            expected = spearmanr(k[0]).statistic
            for sampler in samplers:
                found = spearmanr(drawn(k, 20_000, sampler)).statistic
                assert np.abs(found - expected).max() < 0.04, sampler

    def test_copula_draws_values_of_its_own_between_those_of_the_cells(self):
        k = histories(50)
        links = drawn(k, 2000, "copula")
        assert len(np.unique(links[:, 0])) > 1000
        assert links[:, 0].min() >= k[0, :, 0].min() * (1 - 1e-12)
        assert links[:, 0].max() <= k[0, :, 0].max() * (1 + 1e-12)

    def test_copula_of_few_cells_or_equal_ones(self):
        assert_allclose(drawn(np.full((1, 3, 5), 2.0), 10, "copula"), 2.0)
        assert (drawn(np.zeros((1, 3, 5)), 10, "copula") == 0).all()
        assert_allclose(drawn(histories(1), 10, "copula"), np.tile(histories(1)[0], (10, 1)))


class TestNumbers:
    @each("sampler", sorted(SAMPLERS))
    def test_depend_on_seed_realisation_and_link_only(self, sampler):
        def draw(n=100, **change):
            return drawn(histories(), n, sampler, run_length=2.0, **change)

        assert_array_equal(draw(100), draw(1000)[:100])
        for change in ({"seed": 2}, {"realisation": 5}):
            assert not np.array_equal(draw(), draw(**change))
        # columns of a face are drawn with the links along both axes
        assert np.array_equal(draw(), draw(axis=1)) == (sampler == "block")

    def test_history_draws_whole_cells(self):
        k = histories(30)
        links = drawn(k, 500, "history", seed=3, realisation=2, axis=1)
        assert {tuple(row) for row in links} <= {tuple(row) for row in k[0]}

    def test_neighbours_in_rank_lie_on_both_sides(self):
        """Increments that name their cell: at most two ranks away, as often above as below."""
        n = 101
        k_top = np.arange(1.0, n + 1)
        k = np.stack([k_top + 1000 * np.arange(n), k_top], axis=1)[None]
        links = drawn(k, 5000, "derivative", steps=LoadProgramme.of((1e8, 2e8)), seed=5)
        own, other = links[:, 1] - 1, (links[:, 0] - links[:, 1]) / 1000
        inside = (own > 2) & (own < n - 3)
        away = (other - own)[inside]
        assert np.abs(away).max() == 2
        assert abs(away.mean()) < 0.1
        assert np.abs(other - own).max() <= 4  # at the ends the five lie on one side

    def test_unknown_sampler(self):
        with pytest.raises(InputError, match="history, derivative, copula, block"):
            drawn(histories(), 1, "magic")


class TestRunsOfColumns:
    def columns(self, length, n=6000):
        """Cells that say row and column: 3 rows of 40 columns."""
        k = np.arange(3)[:, None] * 1000.0 + np.arange(40.0)
        k = np.repeat(k[..., None], 2, axis=2)
        path = np.tile(np.arange(3), n)
        return drawn(k, 3 * n, "block", path=path, rows=3, run_length=length, steps=LoadProgramme.of((1e8, 2e8)))

    def test_columns_stay_whole_at_all_loads(self):
        links = self.columns(4.0)
        rows, column = np.divmod(links[:, 0], 1000)
        assert_array_equal(rows, np.tile(np.arange(3), 6000))
        assert_array_equal(column.reshape(-1, 3), np.repeat(column[::3, None], 3, axis=1))
        assert_array_equal(links[:, 0], links[:, 1])

    @each("length", [1.0, 5.0])
    def test_runs_have_the_mean_length_and_start_anywhere(self, length):
        column = self.columns(length)[::3, 0]
        follows = np.diff(column) % 40 == 1
        # a new run begins with 1/length, and by chance where the old one would go on
        assert_allclose(1 - follows.mean(), (1 / length) * (39 / 40), atol=0.02)
        assert_allclose(np.bincount(column.astype(int), minlength=40) / 6000, 1 / 40, atol=0.012)

    def test_length_of_alike_columns(self):
        """Moving averages of n columns: correlations fall linearly to lag n, 1 + 2 Σ = n."""
        rng = np.random.default_rng(0)
        noise = rng.standard_normal((1, 50, 300))
        assert correlation_length(noise) < 1.5
        alike = sum(np.roll(noise, n, axis=2) for n in range(6))
        assert_allclose(correlation_length(alike), 6, rtol=0.15)
        assert correlation_length(np.ones((1, 2, 8))) == 1
        assert correlation_length(np.cumsum(noise[:, :1, :9], axis=2)) <= 4.5

    def test_needs_neighbours(self):
        with pytest.raises(InputError, match="neighbours"):
            drawn(histories(), 3, "block")
