"""Single instructions that numba.cuda has no name for, as intrinsics. Only for a real GPU: the simulator runs the
original formulas."""

from __future__ import annotations

from llvmlite import ir
from numba.cuda import types
from numba.cuda.extending import intrinsic


@intrinsic
def approximate_root_64(typing_context, x):
    """Return 1 / sqrt(x) of a float64 to about 20 bits (PTX rsqrt.approx.ftz.f64)."""

    def generate(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.DoubleType(), [ir.DoubleType()])
        return builder.call(ir.InlineAsm(kind, "rsqrt.approx.ftz.f64 $0, $1;", "=d,d"), arguments)

    return types.float64(types.float64), generate
