"""What it takes to look lanes up in a table, beside ``simd.py``: limits, whole numbers, entries of an array, and masks."""

from __future__ import annotations

import llvmlite.ir as ir
from numba.core import types
from numba.core.extending import intrinsic

from explicitfe.platform.compiled.lanes import WIDTH
from explicitfe.platform.compiled.simd import _F64, _I32, _I64, _VEC, _of_vector, _shuffle, _splat, vector

floor = _of_vector("floor", "The largest whole number that is not above each lane.")
absolute = _of_vector("fabs", "The absolute value of each lane.")


def _above_zero(builder, value):
    return builder.fcmp_ordered(">", value, ir.Constant(_VEC, [0.0] * WIDTH))


@intrinsic
def larger(typingctx, a, b):
    """Lane by lane, the larger of a and b; b if one of them is NaN. One instruction, where ``simd.maximum`` takes six."""

    def lower(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">", *args), *args)

    return vector(vector, vector), lower


@intrinsic
def within(typingctx, value, low, high):
    """A vector, limited to what lies between two floats; NaN becomes the lower one."""

    def lower(context, builder, sig, args):
        low, high = (_splat(builder, bound) for bound in args[1:])
        value = builder.select(builder.fcmp_ordered(">", args[0], low), args[0], low)
        return builder.select(builder.fcmp_ordered("<", value, high), value, high)

    return vector(vector, types.float64, types.float64), lower


def _addresses(context, builder, sig, args):
    """Where in a flat array the entries begin whose places are whole numbers in the lanes, plus an offset."""
    whole = builder.fptosi(args[1], ir.VectorType(_I64, WIDTH))
    data = builder.gep(context.make_array(sig.args[0])(context, builder, args[0]).data, [args[2]])
    return [builder.gep(data, [builder.extract_element(whole, ir.Constant(_I32, lane))]) for lane in range(WIDTH)]


@intrinsic
def entry(typingctx, array, place, offset):
    """The entry of a flat array at the place, a whole number, in each lane, plus an offset."""

    def lower(context, builder, sig, args):
        result = ir.Constant(_VEC, ir.Undefined)
        for lane, address in enumerate(_addresses(context, builder, sig, args)):
            result = builder.insert_element(result, builder.load(address, align=8), ir.Constant(_I32, lane))
        return result

    return vector(array, vector, types.intp), lower


@intrinsic
def entries(typingctx, array, place, offset):
    """What ``entry`` gives, and the next one."""
    result = types.UniTuple(vector, 2)

    def lower(context, builder, sig, args):
        pair = ir.VectorType(_F64, 2).as_pointer()
        pairs = [builder.load(builder.bitcast(at, pair), align=8) for at in _addresses(context, builder, sig, args)]
        while len(pairs) > 1:  # twice as long ones
            every = list(range(4 * WIDTH // len(pairs)))
            pairs = [_shuffle(builder, pairs[k], pairs[k + 1], every) for k in range(0, len(pairs), 2)]
        values = [_shuffle(builder, pairs[0], pairs[0], [2 * lane + side for lane in range(WIDTH)]) for side in (0, 1)]
        return context.make_tuple(builder, result, values)

    return result(array, vector, types.intp), lower


@intrinsic
def any_positive(typingctx, value):
    """Whether a lane is above zero."""

    def lower(context, builder, sig, args):
        bits = builder.bitcast(_above_zero(builder, args[0]), ir.IntType(WIDTH))
        return builder.icmp_unsigned("!=", bits, ir.Constant(ir.IntType(WIDTH), 0))

    return types.boolean(vector), lower


@intrinsic
def is_positive(typingctx, value):
    """1 in each lane above zero, else 0."""

    def lower(context, builder, sig, args):
        return builder.uitofp(_above_zero(builder, args[0]), _VEC)

    return vector(vector), lower
