"""All compile options in one place: nothing else calls ``numba.njit`` bare.

``leaf`` marks a small function that is compiled into its callers. ``bind`` makes a kernel from a template, a function some
of whose globals are placeholders for leaves (a material's ``stress``, an hourglass force): the placeholders are bound,
and the name of the result carries a digest of every source that can reach the machine code. Numba's cache on disk looks
at the name and at the template's own file only, so without the digest an edited law would silently be served stale.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba
from numba.core.dispatcher import Dispatcher

from explicitfe.platform.compiled.cache import store_compiled_code
from explicitfe.platform.compiled.digest import digest_of_bindings

try:
    from explicitfe.platform.compiled.linking import KERNEL, PART, make_part, store
except (ImportError, AttributeError):  # a release of Numba with other internals: it compiles in its own way, which takes longer
    KERNEL, PART, store = {}, {}, Dispatcher.enable_caching

    def make_part(dispatcher: Dispatcher, options: dict[str, object]) -> Dispatcher:
        """The function as Numba compiles it."""
        return dispatcher


# contract: multiply and add may fuse. No reassociation (sums keep their order), no nnan or ninf (NaN checks keep their
# meaning). error_model numpy: a division by zero gives inf, not a branch.
OPTIONS: dict[str, object] = {
    "nopython": True,
    "error_model": "numpy",
    "fastmath": {"contract"},
    "boundscheck": False,
    "nogil": True,
    # No kernel makes or keeps an array, so none needs to count references to them. Counting, which is atomic, cost ten times
    # the work itself in loops over the points of a contact.
    "_nrt": False,
}

Template = Callable[..., Any]  # a function that is compiled for arguments of many types: arrays, lanes, tuples of lanes
PLACEHOLDER: Any = None  # stands for a leaf or a number that ``bind`` puts in its place


def leaf(function: Template) -> Dispatcher:
    """Compile ``function`` into its callers."""
    return make_part(numba.jit(function, forceinline=True, **OPTIONS, **PART), OPTIONS)


def part_of_kernels(function: Template) -> Dispatcher:
    """Compile a large function that several kernels call once, and not into each of its callers."""
    return bind(function, stored=False)


def kernel(function: Template) -> Dispatcher:
    """Compile a function that needs no binding, with its code cached on disk."""
    return bind(function)


def bind(
    template: Template,
    *,
    stored: bool = True,
    inline: bool = False,
    allocates: bool = False,
    apart: bool = False,
    **bindings: Any,
) -> Dispatcher:
    """A compiled copy of ``template`` with the globals named in ``bindings`` replaced.

    Parameters
    ----------
    template : the function as written; its own globals stay as they are.
    stored : keep the machine code on disk. Only the outermost kernel needs it: what it calls is contained in it.
    inline : compile it into its callers, as a leaf.
    allocates : it makes arrays of its own.
    apart : machine code of its own that kernels call by its address (``pieces.call_at``) and Python never calls.
    bindings : placeholder name -> leaf, bound kernel or constant.

    Raises
    ------
    TypeError : a binding names no global that the template reads, so it would change nothing.
    """
    unread = set(bindings) - set(template.__code__.co_names)
    if unread:
        raise TypeError(f"{template.__qualname__} reads no global named {', '.join(sorted(unread))}")
    bound = FunctionType(template.__code__, {**template.__globals__, **bindings}, template.__name__, template.__defaults__, None)
    bound.__doc__ = template.__doc__
    bound.__module__ = template.__module__
    bound.__qualname__ = f"{template.__qualname__}_{digest_of_bindings(bindings)}"
    is_kernel = stored and not inline
    options = OPTIONS | {"_nrt": allocates} | (KERNEL | {"no_cpython_wrapper": apart} if is_kernel else PART)
    dispatcher = numba.jit(bound, forceinline=inline, **options)
    if not is_kernel:
        return make_part(dispatcher, OPTIONS)
    store_compiled_code(dispatcher, store)
    return dispatcher


def sample_compile_s() -> float:
    """CPU time in which this machine compiles a small function, s: the shortest of some; the first loads the compiler."""

    def sample(x: Any) -> Any:
        total = 0.0
        for k in range(len(x)):
            total += math.sqrt(x[k] * x[k] + 1.0) / (1.0 + abs(x[k]))
        return total

    times = []
    for _ in range(4):
        begun = time.process_time()
        numba.jit(sample, **OPTIONS)((1.0, 2.0))
        times.append(time.process_time() - begun)
    return min(times)
