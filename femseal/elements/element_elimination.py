"""Direct solution of an element mesh: nodes are eliminated while blocks of elements are joined, two at a time.

A matrix whose rows sum to zero is kept by its entries off the diagonal, the couples. A pivot is the sum of those of its
row, so that weak couples are not lost beside strong ones as in a factorisation of the matrix.
Sources: Grassmann, Taksar & Heyman, Oper. Res. 33, 1985, 1107 (pivots as sums); Irons, Int. J. Numer. Meth. Eng. 2,
1970, 5 (frontal elimination of assembled elements).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class _Block:
    """Nodes of a block of elements that are left, the number of elements that hold each, and their couples."""

    nodes: Indices
    held_by: Indices
    couples: Array


@dataclass(frozen=True, eq=False)
class _Pivots:
    """Eliminated nodes, those left in their block, couples of the former with all, and the sums of these."""

    nodes: Indices
    left: Indices
    couples: Array
    total: Array


@dataclass(frozen=True, eq=False)
class Factors:
    """The eliminated system of an element mesh: its pivots in order, and the number of all nodes."""

    pivots: list[_Pivots]
    nodes: int

    def with_held(self, held: Indices, values: Array) -> Array:
        """Values (nodes, m) that balance at every node, with those (h, m) of the nodes that are held."""
        x = np.zeros((self.nodes, values.shape[1]))
        x[held] = values
        for pivots in reversed(self.pivots):
            x[pivots.nodes] = _substituted(pivots.couples, pivots.total, x[pivots.left])
        return x

    def under(self, sources: Array) -> Array:
        """Values (nodes,) for sources at the nodes (nodes,), with 0 at those that are held."""
        flow, x = sources.copy(), np.zeros((self.nodes, 1))
        own = []
        for pivots in self.pivots:
            inside, passed = _passed_on(pivots.couples, pivots.total, flow[pivots.nodes])
            own.append(inside)
            flow[pivots.left] += passed
        for pivots, inside in zip(reversed(self.pivots), reversed(own), strict=True):
            x[pivots.nodes] = _substituted(pivots.couples, pivots.total, x[pivots.left], inside)
        return x[:, 0]


def factored(
    couples: list[Array], numbers: list[Indices], cells: tuple[int, int], held: Indices, nodes: int
) -> Factors:
    """Eliminate all nodes of element couples but those held.

    Parameters
    ----------
    couples, numbers : of every element its couples (n, n) and the numbers of its nodes (n,), row after row.
    cells : rows and columns of elements, which tell what lies side by side.
    held (h,) : nodes that are held.
    nodes : number of all nodes. Those that nothing joins to a held one get 0.
    """
    uses = np.zeros(nodes, np.int64)
    for number in numbers:
        uses[np.unique(number)] += 1
    uses[held] += 1  # a held node is never complete
    stack: list[_Pivots] = []

    def joined(top: int, bottom: int, left: int, right: int) -> _Block:
        if bottom - top == 1 and right - left == 1:
            place = top * cells[1] + left
            block = _of_element(couples[place], numbers[place])
        elif bottom - top >= right - left:
            middle = (top + bottom) // 2
            block = _merged(joined(top, middle, left, right), joined(middle, bottom, left, right))
        else:
            middle = (left + right) // 2
            block = _merged(joined(top, bottom, left, middle), joined(top, bottom, middle, right))
        return _without_complete(block, uses, stack)

    joined(0, cells[0], 0, cells[1])
    return Factors(stack, nodes)


def _of_element(couples: Array, number: Indices) -> _Block:
    nodes, place = np.unique(number, return_inverse=True)
    summed = np.zeros((nodes.size, nodes.size))
    np.add.at(summed, (place[:, None], place), couples)
    return _Block(nodes, np.ones(nodes.size, np.int64), summed)


def _merged(one: _Block, other: _Block) -> _Block:
    nodes = np.union1d(one.nodes, other.nodes)
    summed, held_by = np.zeros((nodes.size, nodes.size)), np.zeros(nodes.size, np.int64)
    for block in (one, other):
        place = np.searchsorted(nodes, block.nodes)
        summed[np.ix_(place, place)] += block.couples
        held_by[place] += block.held_by
    return _Block(nodes, held_by, summed)


def _without_complete(block: _Block, uses: Indices, stack: list[_Pivots]) -> _Block:
    """Eliminate the nodes of which all elements are in the block."""
    complete = block.held_by == uses[block.nodes]
    first, rest = np.flatnonzero(complete), np.flatnonzero(~complete)
    if not first.size:
        return block
    order = np.concatenate([first, rest])
    p = first.size
    couples = np.ascontiguousarray(block.couples[np.ix_(order, order)])
    total = _eliminated(couples, p)
    stack.append(_Pivots(block.nodes[first], block.nodes[rest], couples[:p].copy(), total))
    return _Block(block.nodes[rest], block.held_by[rest], couples[p:, p:])


@njit(cache=True, nogil=True)
def _eliminated(couples, p):
    """Eliminate the first p nodes in place; return the sums of their couples with later ones, 0 without any."""
    n = len(couples)
    total = np.zeros(p)
    for i in range(p):
        for j in range(i + 1, n):
            total[i] += couples[i, j]
        if total[i] == 0.0:
            continue
        for j in range(i + 1, p):
            if couples[i, j] != 0.0:
                share = couples[i, j] / total[i]
                for k in range(i + 1, n):
                    if k != j:
                        couples[j, k] += share * couples[i, k]
    if p < n:
        later = couples[:p, p:].copy()
        shares = np.zeros((p, n - p))
        for i in range(p):
            if total[i] != 0.0:
                for j in range(n - p):
                    shares[i, j] = later[i, j] / total[i]
        product = np.dot(shares.T, later)
        for i in range(p, n):
            for j in range(p, n):
                couples[i, j] += product[i - p, j - p]
            couples[i, i] = 0.0
    return total


@njit(cache=True, nogil=True)
def _passed_on(couples, total, sources):
    """Sources of the pivots with what earlier ones pass on to them, and what all pass on to the nodes left."""
    p, n = couples.shape
    own, passed = sources.copy(), np.zeros(n - p)
    for i in range(p):
        if total[i] == 0.0:
            own[i] = 0.0
            continue
        share = own[i] / total[i]
        for j in range(i + 1, p):
            own[j] += couples[i, j] * share
        for j in range(p, n):
            passed[j - p] += couples[i, j] * share
    return own, passed


@njit(cache=True, nogil=True)
def _substituted(couples, total, left, sources=None):
    """Values of the pivots, means of those of their neighbours at the time they were eliminated, and their sources'."""
    p, m = total.size, left.shape[1]
    x = np.zeros((p, m))
    for i in range(p - 1, -1, -1):
        if total[i] == 0.0:
            continue
        for q in range(m):
            value = 0.0 if sources is None else sources[i]
            for j in range(i + 1, p):
                value += couples[i, j] * x[j, q]
            for j in range(len(left)):
                value += couples[i, p + j] * left[j, q]
            x[i, q] = value / total[i]
    return x
