"""Cache on disk for functions that only kernels call. Other kernels and other processes load them.

The cache contains LLVM bitcode before optimisation, so that a kernel does not depend on whether its parts were loaded or lowered.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from types import FunctionType
from typing import Any
from weakref import ref

from numba.core.caching import CompileResultCacheImpl, NullCache
from numba.core.compiler import CompileResult
from numba.core.dispatcher import Dispatcher

from explicitfe.platform.compiled.cache import CheckedCache
from explicitfe.platform.compiled.digest import name_of_part
from explicitfe.platform.compiled.parts import PARTS, PartLibrary, entry_of_part


class PartCache(NullCache):
    """Cache of one function. It is set up when the function is first compiled, as most processes compile nothing."""

    def __init__(self, dispatcher: Dispatcher) -> None:
        self._dispatcher = ref(dispatcher)
        PARTS[dispatcher.py_func] = self._dispatcher

    def load_overload(self, sig: object, target_context: Any) -> Any:
        """Load the code of a function for types of arguments; None if it is not stored."""
        return self._files.load_overload(sig, target_context)

    def save_overload(self, sig: object, data: Any) -> None:
        """Store the code of a function for types of arguments."""
        self._files.save_overload(sig, data)

    @cached_property
    def _files(self) -> Any:
        dispatcher = self._dispatcher()
        assert dispatcher is not None
        function = dispatcher.py_func
        named = FunctionType(function.__code__, function.__globals__, function.__name__, None, function.__closure__)
        named.__module__ = function.__module__
        named.__qualname__ = name_of_part(function).removeprefix(f"{function.__module__}.")
        try:
            return _Files(named)
        except RuntimeError:  # no folder can be written, or the function stands in no file
            return NullCache()


class _Form(CompileResultCacheImpl):
    """Conversion of a compiled function to and from its stored form."""

    def reduce(self, cres: CompileResult) -> tuple[Any, ...]:
        """Return the bitcode, the called parts, and the description that callers need."""
        library = cres.library
        described = copy(cres.fndesc)
        described.typemap = described.calltypes = None
        called = [(each.part, each.arguments) for each in library._linking_libraries]
        return (library.identity(), "part", library.alone().as_bitcode()), called, described, cres.environment, cres.signature

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> CompileResult | None:
        """Restore a function with the parts that it calls; return None if this process lacks one of them."""
        (identity, _, code), called, described, environment, signature = payload
        libraries = []
        for part, arguments in called:
            dispatcher = _part_of_name(part)
            if dispatcher is None:
                return None
            dispatcher.compile(arguments)
            libraries.append(dispatcher.overloads[arguments].library)
        return CompileResult(
            target_context=target_context,
            typing_context=target_context.typing_context,
            library=PartLibrary.from_bitcode(target_context.codegen(), identity, code, libraries),
            entry_point=entry_of_part(),
            fndesc=described,
            environment=environment,
            signature=signature,
            objectmode=False,
            lifted=(),
            typing_error=None,
            type_annotation=None,
            call_helper=None,
            metadata=None,
            reload_init=(),
            referenced_envs=(),
        )


def _part_of_name(name: str) -> Dispatcher | None:
    """Return the function with this name if this process has imported it, otherwise None."""
    for function, dispatcher in PARTS.items():
        if name.startswith(f"{function.__module__}.{function.__qualname__}_") and name_of_part(function) == name:
            return dispatcher()
    return None


class _Files(CheckedCache):
    """Files of a function, with checksums."""

    _impl_class = _Form
