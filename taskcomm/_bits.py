"""Words of 64 bits, compiled."""

from typing import Any

from llvmlite import ir
from numba import config, types
from numba.extending import intrinsic


def _of_python(bits: Any) -> int:
    """The number of the lowest bit that is set."""
    return (int(bits) & -int(bits)).bit_length() - 1


@intrinsic
def _of_the_machine(_: Any, bits: types.Integer) -> Any:
    """The same, one instruction of most processors."""

    def code(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> Any:
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.uint64(types.uint64), code


lowest: Any = _of_python if getattr(config, "DISABLE_JIT", 0) else _of_the_machine
