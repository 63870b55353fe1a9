"""Questions and choices lane by lane: what takes the place of a branch where the lanes of a vector do not agree."""

from __future__ import annotations

import llvmlite.ir as ir
from numba.core import types
from numba.core.extending import intrinsic

from explicitfe.platform.compiled.simd import WIDTH, vector

_VEC = ir.VectorType(ir.DoubleType(), WIDTH)


@intrinsic
def any_below_zero(typingctx, value):
    """Whether any lane is below zero or not a number."""

    def lower(context, builder, sig, args):
        below = builder.fcmp_unordered("<", args[0], ir.Constant(_VEC, [0.0] * WIDTH))
        bits = builder.bitcast(below, ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(vector), lower


@intrinsic
def choose(typingctx, test, a, b):
    """Lane by lane, a where the test is above zero, else b."""

    def lower(context, builder, sig, args):
        test, a, b = args
        return builder.select(builder.fcmp_ordered(">", test, ir.Constant(_VEC, [0.0] * WIDTH)), a, b)

    return vector(vector, vector, vector), lower
