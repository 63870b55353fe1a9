"""A vector of ``WIDTH`` float64 lanes inside compiled kernels: one lane an element.

Numba has no vector type, and LLVM's own vectoriser gives up on a 500-flop loop body. So this module teaches Numba one:
a value that LLVM holds in vector registers, with ``+ - * /``, loads and stores, and the two moves a finite element
needs, ``gather_rows`` (the node vectors of eight corners into lanes) and ``scatter_rows`` (the way back).

A law written with ``+ - * /`` alone works on a float and on a vector: it is stated once, tested on floats, and run on
vectors. Floating-point contraction (fused multiply-add) is allowed, reordering is not, and NaN keeps its meaning.
"""

from __future__ import annotations

import math
import operator

import llvmlite.ir as ir
from numba.core import types
from numba.core.errors import TypingError
from numba.core.extending import intrinsic, models, overload, register_model, type_callable
from numba.core.imputils import lower_builtin, lower_cast

from explicitfe.platform.compiled.jit import PART
from explicitfe.platform.compiled.lanes import WIDTH

ROW = 4  # float64 in one node row [x, y, z, padding]: 32 bytes, so that a corner is one vector load

_F64 = ir.DoubleType()
_I32 = ir.IntType(32)
_I64 = ir.IntType(64)
_VEC = ir.VectorType(_F64, WIDTH)
_ROW = ir.VectorType(_F64, ROW)
_FLAGS = ("contract",)


class VectorType(types.Type):
    """Numba's name for ``WIDTH`` float64 lanes."""

    def __init__(self) -> None:
        super().__init__(name=f"float64x{WIDTH}")


vector = VectorType()


@register_model(VectorType)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _VEC)


def _is_operand(ty) -> bool:
    return ty == vector or isinstance(ty, types.Float | types.Integer)


def _splat(builder, scalar):
    packed = builder.insert_element(ir.Constant(_VEC, ir.Undefined), scalar, ir.Constant(_I32, 0))
    return builder.shuffle_vector(packed, packed, ir.Constant(ir.VectorType(_I32, WIDTH), [0] * WIDTH))


@lower_cast(types.Float, vector)
@lower_cast(types.Integer, vector)
def _scalar_to_vector(context, builder, fromty, toty, val):
    return _splat(builder, context.cast(builder, val, fromty, types.float64))


def _define_operator(op, emit) -> None:
    @type_callable(op)
    def typer(context):
        def resolve(a, b):
            if (a == vector or b == vector) and _is_operand(a) and _is_operand(b):
                return vector
            return None

        return resolve

    def lower(context, builder, sig, args):
        a, b = (context.cast(builder, v, ty, vector) for v, ty in zip(args, sig.args, strict=True))
        return emit(builder, a, b)

    scalars = (types.Float, types.Integer)
    for pair in ((vector, vector), *((vector, s) for s in scalars), *((s, vector) for s in scalars)):
        lower_builtin(op, *pair)(lower)


_define_operator(operator.add, lambda b, x, y: b.fadd(x, y, flags=_FLAGS))
_define_operator(operator.sub, lambda b, x, y: b.fsub(x, y, flags=_FLAGS))
_define_operator(operator.mul, lambda b, x, y: b.fmul(x, y, flags=_FLAGS))
_define_operator(operator.truediv, lambda b, x, y: b.fdiv(x, y, flags=_FLAGS))


@type_callable(operator.neg)
def _type_neg(context):
    return lambda a: vector if a == vector else None


@lower_builtin(operator.neg, vector)
def _lower_neg(context, builder, sig, args):
    return builder.fneg(args[0])


def _pointer(context, builder, ty, value, index):
    """Address of element ``index`` of a contiguous array seen as flat."""
    data = context.make_array(ty)(context, builder, value).data
    return builder.gep(data, [index])


@intrinsic
def splat(typingctx, value):
    """A vector with ``value`` in every lane."""

    def lower(context, builder, sig, args):
        return _splat(builder, args[0])

    return vector(types.float64), lower


@intrinsic
def load(typingctx, array, index):
    """The ``WIDTH`` float64 that start at flat position ``index`` of a contiguous array."""

    def lower(context, builder, sig, args):
        address = _pointer(context, builder, sig.args[0], args[0], args[1])
        return builder.load(builder.bitcast(address, _VEC.as_pointer()), align=8)

    return vector(array, types.intp), lower


@intrinsic
def store(typingctx, array, index, value):
    """Write a vector at flat position ``index`` of a contiguous array."""

    def lower(context, builder, sig, args):
        address = _pointer(context, builder, sig.args[0], args[0], args[1])
        builder.store(args[2], builder.bitcast(address, _VEC.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.none(array, types.intp, vector), lower


@intrinsic(prefer_literal=True)
def load_many(typingctx, array, index, count):
    """``count`` vectors (a literal number) that stand one after the other from flat position ``index`` on, as a tuple."""
    if not isinstance(count, types.IntegerLiteral):
        raise TypingError("load_many: the count must be a literal or a global constant")
    number = count.literal_value
    result = types.UniTuple(vector, number)

    def lower(context, builder, sig, args):
        values = []
        for k in range(number):
            at = builder.add(args[1], ir.Constant(_I64, k * WIDTH))
            address = _pointer(context, builder, sig.args[0], args[0], at)
            values.append(builder.load(builder.bitcast(address, _VEC.as_pointer()), align=8))
        return context.make_tuple(builder, result, values)

    return result(array, types.intp, count), lower


@intrinsic
def load_fourth(typingctx, rows, at):
    """The fourth number of each node row, in all lanes that ``load(rows, at)`` fills from that row."""

    def lower(context, builder, sig, args):
        if WIDTH < ROW:  # half a row
            fourth = builder.or_(args[1], ir.Constant(_I64, ROW - 1))
            return _splat(builder, builder.load(_pointer(context, builder, sig.args[0], args[0], fourth)))
        address = _pointer(context, builder, sig.args[0], args[0], args[1])
        loaded = builder.load(builder.bitcast(address, _VEC.as_pointer()), align=8)
        return _shuffle(builder, loaded, loaded, [lane | (ROW - 1) for lane in range(WIDTH)])

    return vector(rows, types.intp), lower


# Shuffles that x86 has single instructions for: within the 16-byte parts of a register, and of whole parts. Eight lanes are
# shuffled as whole registers, half as many shuffles as four by four: Intel's processors do them at one port alone. With that,
# with rows told by where they begin and with sums that take a row from memory, a block of hex8-stiffness takes 1 590 operations
# instead of 1 860 and 500 cycles instead of 570 (llvm-mca, Skylake-X); AMD's Zen 4 is as fast either way.
_EVEN = [entry for lane in range(0, max(WIDTH, ROW), 2) for entry in (lane, max(WIDTH, ROW) + lane)]
_ODD = [entry + 1 for entry in _EVEN]
_LOWER = [entry for entry in range(2 * max(WIDTH, ROW)) if entry % ROW < 2]
_UPPER = [entry + 2 for entry in _LOWER]


def _shuffle(builder, a, b, mask):
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_I32, len(mask)), mask))


@intrinsic
def gather_rows(typingctx, rows, entry, start):
    """Components x, y, z of the node rows that begin at ``entry[start : start + WIDTH]``, each as one vector."""
    result = types.UniTuple(vector, 3)

    def lower(context, builder, sig, args):
        loaded = [builder.load(_row_address(context, builder, sig, args, lane), align=8) for lane in range(WIDTH)]
        if WIDTH < ROW:  # two rows: their x, y and z side by side
            values = [_shuffle(builder, loaded[0], loaded[1], [k, ROW + k]) for k in range(3)]
            return context.make_tuple(builder, result, values)
        if WIDTH > ROW:  # rows 0 and 2, 1 and 3, 4 and 6, 5 and 7 in one register each
            loaded = [_shuffle(builder, loaded[k], loaded[k + 2], list(range(WIDTH))) for k in (0, 1, 4, 5)]
        r0, r1, r2, r3 = loaded
        xz_low, xz_top = _shuffle(builder, r0, r1, _EVEN), _shuffle(builder, r2, r3, _EVEN)
        y_low, y_top = _shuffle(builder, r0, r1, _ODD), _shuffle(builder, r2, r3, _ODD)
        values = [
            _shuffle(builder, xz_low, xz_top, _LOWER),
            _shuffle(builder, y_low, y_top, _LOWER),
            _shuffle(builder, xz_low, xz_top, _UPPER),
        ]
        return context.make_tuple(builder, result, values)

    return result(rows, entry, types.intp), lower


@intrinsic
def scatter_rows(typingctx, rows, entry, start, x, y, z):
    """Add the vectors x, y, z to the node rows that begin at ``entry[start : start + WIDTH]``, lane after lane."""

    def lower(context, builder, sig, args):
        x, y, z = args[3:]

        def add(lane, row_value):
            address = _row_address(context, builder, sig, args, lane)
            builder.store(builder.fadd(builder.load(address, align=8), row_value), address, align=8)

        zero = ir.Constant(_VEC, [0.0] * WIDTH)
        if WIDTH < ROW:  # two rows: x and y of both, z and zero of both, then row by row
            xy = _shuffle(builder, x, y, [0, 1, 2, 3])
            z0 = _shuffle(builder, z, zero, [0, 1, 2, 3])
            for lane in range(WIDTH):
                add(lane, _shuffle(builder, xy, z0, [lane, 2 + lane, 4 + lane, 6 + lane]))
            return context.get_dummy_value()
        xy = _shuffle(builder, x, y, _EVEN), _shuffle(builder, x, y, _ODD)
        z0 = _shuffle(builder, z, zero, _EVEN), _shuffle(builder, z, zero, _ODD)
        for lane in range(0, WIDTH, ROW):  # rows lane and lane + 2, lane + 1 and lane + 3
            for k in range(2):
                both = [0, 1, WIDTH, WIDTH + 1, 2, 3, WIDTH + 2, WIDTH + 3]
                pair = _shuffle(builder, xy[k], z0[k], [lane + entry for entry in both])
                add(lane + k, _shuffle(builder, pair, pair, [0, 1, 2, 3]))
                add(lane + k + 2, _shuffle(builder, pair, pair, [4, 5, 6, 7]))
        return context.get_dummy_value()

    return types.none(rows, entry, types.intp, vector, vector, vector), lower


def _row_address(context, builder, sig, args, lane):
    """Address of the row of a lane; rows, entry and start are the first three arguments."""
    at = builder.add(args[2], ir.Constant(_I64, lane))
    entry = builder.load(_pointer(context, builder, sig.args[1], args[1], at))
    address = _pointer(context, builder, sig.args[0], args[0], builder.zext(entry, _I64))
    return builder.bitcast(address, _ROW.as_pointer())


def _reduction(name, doc, emit):
    @intrinsic
    def reduce(typingctx, value):
        def lower(context, builder, sig, args):
            lanes = [builder.extract_element(args[0], ir.Constant(_I32, k)) for k in range(WIDTH)]
            while len(lanes) > 1:
                lanes = [emit(builder, lanes[k], lanes[k + 1]) for k in range(0, len(lanes), 2)]
            return lanes[0]

        return types.float64(vector), lower

    reduce.__doc__ = doc
    reduce._name = name
    return reduce


def _smaller(builder, a, b):
    # ult lets a NaN in b through, and so does not keep one in a: that takes a second compare
    smaller = builder.select(builder.fcmp_unordered("<", b, a), b, a)
    return builder.select(builder.fcmp_unordered("uno", a, a), a, smaller)


sum_lanes = _reduction("sum_lanes", "Sum over the lanes.", lambda b, x, y: b.fadd(x, y))
min_lanes = _reduction("min_lanes", "Smallest lane; NaN if any is.", _smaller)


@intrinsic
def minimum(typingctx, a, b):
    """Lane by lane, the smaller of a and b; NaN if either is."""

    def lower(context, builder, sig, args):
        return _smaller(builder, *args)

    return vector(vector, vector), lower


@intrinsic
def _cbrt_guess(typingctx, value):
    """A guess of value^(-1/3), within 4 %, from the exponent bits (as in fdlibm's cbrt): right over the whole range."""

    def lower(context, builder, sig, args):
        wide = ir.VectorType(_I64, WIDTH)
        half = ir.VectorType(_I32, WIDTH)
        const = lambda ty, k: ir.Constant(ty, [k] * WIDTH)  # noqa: E731
        bits = builder.bitcast(args[0], wide)
        high = builder.trunc(builder.lshr(bits, const(wide, 32)), half)
        guess = builder.sub(const(half, 0x553EF000), builder.udiv(high, const(half, 3)))
        return builder.bitcast(builder.shl(builder.zext(guess, wide), const(wide, 32)), _VEC)

    return vector(vector), lower


def _by_lane(name, doc, declare):
    """An intrinsic that calls a scalar function for each lane: for what is rare, or no bottleneck."""

    @intrinsic
    def apply(typingctx, value):
        def lower(context, builder, sig, args):
            function = declare(builder.module)
            result = args[0]
            for lane in range(WIDTH):
                at = ir.Constant(_I32, lane)
                result = builder.insert_element(result, builder.call(function, [builder.extract_element(args[0], at)]), at)
            return result

        return vector(vector), lower

    apply.__doc__ = doc
    apply._name = name
    return apply


def _extern(name):
    scalar = ir.FunctionType(_F64, [_F64])

    def declare(module):
        known = module.globals.get(name)
        return known if known is not None else ir.Function(module, scalar, name)

    return declare


def _of_vector(name, doc):
    """An intrinsic of LLVM that takes a whole vector."""

    @intrinsic
    def apply(typingctx, value):
        def lower(context, builder, sig, args):
            known = builder.module.globals.get(f"llvm.{name}.v{WIDTH}f64")
            declared = known if known is not None else ir.Function(builder.module, whole, f"llvm.{name}.v{WIDTH}f64")
            return builder.call(declared, args)

        return vector(vector), lower

    whole = ir.FunctionType(_VEC, [_VEC])
    apply.__doc__ = doc
    apply._name = name
    return apply


_sqrt_lanes = _of_vector("sqrt", "Square root of every lane, in one instruction.")


_exp_lanes = _by_lane("_exp_lanes", "Exponential lane by lane.", lambda module: module.declare_intrinsic("llvm.exp", [_F64]))
_erf_lanes = _by_lane("_erf_lanes", "Error function lane by lane.", _extern("erf"))
_log_lanes = _by_lane("_log_lanes", "Logarithm lane by lane.", lambda module: module.declare_intrinsic("llvm.log", [_F64]))


_INLINE = {"forceinline": True, **PART}


def exp(value):
    """Exponential of a float or of a vector."""
    return math.exp(value)


@overload(exp, jit_options=_INLINE)
def _exp(value):
    return (lambda value: _exp_lanes(value)) if value == vector else (lambda value: math.exp(value))


def erf(value):
    """Error function of a float or of a vector."""
    return math.erf(value)


@overload(erf, jit_options=_INLINE)
def _erf(value):
    return (lambda value: _erf_lanes(value)) if value == vector else (lambda value: math.erf(value))


@intrinsic
def maximum(typingctx, a, b):
    """Lane by lane, the larger of a and b; NaN if either is."""

    def lower(context, builder, sig, args):
        a, b = args
        larger = builder.select(builder.fcmp_unordered(">", b, a), b, a)
        return builder.select(builder.fcmp_unordered("uno", a, a), a, larger)

    return vector(vector, vector), lower


def log(value):
    """Natural logarithm of a float or of a vector."""
    return math.log(value)


@overload(log, jit_options=_INLINE)
def _log(value):
    return (lambda value: _log_lanes(value)) if value == vector else (lambda value: math.log(value))


def square_root(value):
    """Square root of a float or of a vector."""
    return math.sqrt(value)


@overload(square_root, jit_options=_INLINE)
def _square_root(value):
    return (lambda value: _sqrt_lanes(value)) if value == vector else (lambda value: math.sqrt(value))


def inverse_cube_root(value):
    """value^(-1/3) for value > 0, of a float or of a vector."""
    return value ** (-1.0 / 3.0)


@overload(inverse_cube_root, jit_options=_INLINE)
def _inverse_cube_root(value):
    if value == vector:

        def by_newton(value):  # y <- y (4 - value y^3) / 3 doubles the digits at each turn: 3e-2, 2e-3, 1e-5, 3e-10, rounding
            y = _cbrt_guess(value)
            third = value * (1.0 / 3.0)
            for _ in range(4):
                y = y * (4.0 / 3.0 - (third * y) * (y * y))
            return y

        return by_newton

    def by_power(value):
        return value ** (-1.0 / 3.0)

    return by_power
