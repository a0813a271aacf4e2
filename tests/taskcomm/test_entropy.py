"""The logarithm of the search is the logarithm, and its lowest bit the lowest."""

import math
import sys

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st
from kernels import outside

from taskcomm import _bits, _entropy
from taskcomm._bits import _of_python

divergence, h2, log, xlogx = map(outside, (_entropy.divergence, _entropy.h2, _entropy.log, _entropy.xlogx))
lowest = outside(_bits.lowest)


@given(st.floats(sys.float_info.min, sys.float_info.max))
@example(sys.float_info.min)
@example(1.0)
@example(math.nextafter(1.0, 0.0))
@example(math.nextafter(2.0, 0.0))
def test_log_is_the_logarithm(x: float) -> None:
    assert abs(log(x) - math.log(x)) <= 1e-14 + 4e-16 * abs(math.log(x))


def test_the_error_of_log_is_that_of_its_series_in_every_interval_of_its_table() -> None:
    edges = 1.0 + np.arange(257) / 256
    points = np.unique([edges, np.nextafter(edges, 0), np.nextafter(edges, 3), edges + 1 / 1024])
    errors = [abs(log(x) - math.log(x)) for x in points]
    assert 1e-15 < max(errors) < 1e-14


@given(st.floats(0.0, 1.0))
@example(0.0)
@example(5e-324)
def test_x_log_x_is_zero_at_zero_and_right_elsewhere(x: float) -> None:
    assert abs(xlogx(x) - (x * math.log(x) if x else 0.0)) < 1e-14


@given(st.floats(1e-12, 1 - 1e-12), st.floats(1e-12, 1 - 1e-12))
def test_entropy_and_divergence_are_by_definition(p: float, q: float) -> None:
    entropy = -p * math.log(p) - (1 - p) * math.log(1 - p)
    crossed = -p * math.log(q) - (1 - p) * math.log(1 - q)
    assert abs(h2(p) - entropy) < 1e-13
    assert abs(divergence(p, q) - (crossed - entropy)) < 1e-13


@given(st.integers(1, (1 << 64) - 1))
@example(1 << 63)
def test_the_lowest_bit_is_the_lowest(bits: int) -> None:
    at = lowest(np.uint64(bits))
    assert at == _of_python(bits)
    assert bits >> at & 1 == 1
    assert bits % (1 << at) == 0
