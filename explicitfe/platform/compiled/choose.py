"""Single lanes of vectors, and choices lane by lane, which take the place of a branch where the lanes do not agree."""

from __future__ import annotations

import llvmlite.ir as ir
from numba.core import types
from numba.core.errors import TypingError
from numba.core.extending import intrinsic

from explicitfe.platform.compiled.simd import WIDTH, _pointer, vector

_INDEX = ir.IntType(64)
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


@intrinsic(prefer_literal=True)
def load_lane(typingctx, array, index, count):
    """One lane of ``count`` vectors (a literal number) that stand one after the other, as a tuple of float64; ``index`` is the
    flat position of the lane in the first of them."""
    if not isinstance(count, types.IntegerLiteral):
        raise TypingError("load_lane: the count must be a literal or a global constant")
    number = count.literal_value
    result = types.UniTuple(types.float64, number)

    def lower(context, builder, sig, args):
        places = [builder.add(args[1], ir.Constant(_INDEX, k * WIDTH)) for k in range(number)]
        values = [builder.load(_pointer(context, builder, sig.args[0], args[0], at), align=8) for at in places]
        return context.make_tuple(builder, result, values)

    return result(array, types.intp, count), lower
