# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""How the search's kernels are compiled, and x ln x, which is most of what they do.

The logarithm is our own: calls of the C library's were a quarter of a search's time. With x = 2^e m, c the
middle of that 1/256 of [1, 2) in which m lies, and r = m / c - 1,

    ln x = e ln 2 + ln c + ln(1 + r),    -1/512 <= r <= 1/512,

the last by its series to the fourth power: within 1e-14, and what rounding does to e ln 2.
"""

import numpy as np

from taskcomm.compiling import kernel

SEARCH = "the planner's search"

# Calls that pass this many arrays cost more than what is done in them; references need no counting, since
# nothing is allocated. What only other kernels call is compiled in about two thirds of the time.
_LIKE = {"error_model": "numpy", "_nrt": False}
_INSIDE = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
entry = kernel(__name__, SEARCH, forceinline=True, **_LIKE)
compiled = kernel(__name__, SEARCH, forceinline=True, **_INSIDE, **_LIKE)
# Where only sums and entropies are found, a product and a sum may be rounded once.
fused = kernel(__name__, SEARCH, forceinline=True, fastmath={"contract"}, **_INSIDE, **_LIKE)
# The same, but called: what does enough to be worth it, and is needed in several places.
called = kernel(__name__, SEARCH, fastmath={"contract"}, **_INSIDE, **_LIKE)

_MIDDLES = 1.0 + (np.arange(256) + 0.5) / 256
_TABLE = np.column_stack([1.0 / _MIDDLES, np.log(_MIDDLES)])
_LN2 = np.log(2.0)
_EXPONENT, _MANTISSA, _ONE = 52, (1 << 52) - 1, 1023 << 52  # of a double


@fused
def log(x):
    """ln x of a positive normal number."""
    bits = np.float64(x).view(np.int64)
    at = bits >> _EXPONENT - 8 & 255
    r = np.int64(bits & _MANTISSA | _ONE).view(np.float64) * _TABLE[at, 0] - 1.0
    square = r * r
    series = (r - 0.5 * square) + square * r * (1.0 / 3.0 - 0.25 * r)
    return ((bits >> _EXPONENT) - 1023) * _LN2 + _TABLE[at, 1] + series


@fused
def xlogx(x):
    """x ln x, 0 at 0 (and within 1e-300 of it for numbers so small that they have lost precision)."""
    return x * log(x) if x > 0.0 else 0.0


@fused
def h2(p):
    """The entropy of a press of probability p, in nats."""
    return -xlogx(p) - xlogx(1.0 - p)


@fused
def divergence(p, q):
    """KL of press probability p from q, in nats."""
    return xlogx(p) + xlogx(1.0 - p) - p * np.log(q) - (1.0 - p) * np.log(1.0 - q)
