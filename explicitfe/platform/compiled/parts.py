"""How Numba compiles kernels here: what a kernel calls is optimised and made machine code once, with the kernel.

Numba compiles each function to machine code by itself, and again with each function that calls it. A leaf of a material law
would so be optimised alone, with the internal force, with the step, and with the run. Once is enough, which halves the time to
compile a kernel. The passes are Numba's own; what differs is when the code of a called function is linked.
"""

from __future__ import annotations

import gc
import hashlib
from types import FunctionType
from typing import Any, ClassVar
from weakref import WeakKeyDictionary, ref

from llvmlite import binding as llvm
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import NativeLowering

from explicitfe.platform.compiled.digest import digest_of_part, name_of_part
from explicitfe.platform.compiled.operator_types import type_operators_once

PARTS: WeakKeyDictionary[FunctionType, ref[Dispatcher]] = WeakKeyDictionary()
"""Functions that only kernels call."""


class PartLibrary(JITCodeLibrary):
    """LLVM IR of a function that only kernels call, without the functions that it calls, which are linked into the kernel.

    The name contains a digest of the sources, so that it identifies the same code in each process.
    """

    part: str | None = None
    arguments: tuple[Any, ...] = ()

    def finalize(self) -> None:
        """Link called functions that are not parts, and rename them, as Numba numbers them differently in each process."""
        self._raise_if_finalized()
        parts = [library for library in self._linking_libraries if isinstance(library, PartLibrary) and library.part]
        own = [function.name for function in self._final_module.functions if not function.is_declaration]
        for library in dict.fromkeys(self._linking_libraries):
            if library not in parts:
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        suffix = hashlib.sha256("".join(own).encode()).hexdigest()[:16]
        for function in self._final_module.functions:
            if not function.is_declaration and function.name not in own:
                function.name = f"{function.name}.{suffix}"
        self._linking_libraries: list[CPUCodeLibrary] = parts
        self._finalize_dynamic_globals()
        self._finalized = True

    @classmethod
    def from_bitcode(
        cls, codegen: Any, identity: tuple[str, str, tuple[Any, ...]], bitcode: bytes, called: list[Any]
    ) -> PartLibrary:
        """Create a library from its :meth:`identity`, the bitcode of :meth:`alone`, and the libraries of called parts."""
        name, part, arguments = identity
        library = cls(codegen, name)
        library.part, library.arguments = part, arguments
        library._shared_module = llvm.parse_bitcode(bitcode)
        library._linking_libraries = called
        library._finalized = True
        return library

    def identity(self) -> tuple[str, str | None, tuple[Any, ...]]:
        """Name of the library, of the function, and the types of its arguments."""
        return self.name, self.part, self.arguments

    def alone(self) -> Any:
        """LLVM module of the function without what it calls."""
        return super()._get_module_for_linking()

    def _get_module_for_linking(self) -> Any:
        """Module for a function that Numba compiles by its own passes."""
        module = self.alone().clone()
        _link(module, self._linking_libraries)
        return module


class KernelLibrary(JITCodeLibrary):
    """The code of a kernel with that of all it calls."""

    def finalize(self) -> None:
        """Link every function that is reached once, optimise the whole, and make machine code of it."""
        libraries, module = self._linking_libraries, self._final_module
        _link(module, libraries)
        lacking = [function.name for function in module.functions if function.is_declaration and function.name.startswith("_ZN")]
        assert not lacking, f"code of {self.name} lacks {lacking}"  # calling them would end the process
        self._linking_libraries: list[CPUCodeLibrary] = []  # nothing is left to link
        super().finalize()


def _link(module: Any, libraries: list[CPUCodeLibrary]) -> None:
    """Link libraries, and those that they call, into a module."""
    reached: dict[CPUCodeLibrary, None] = {}
    _note_reached(libraries, reached)
    # LLVM links the functions of a library that have been asked for by then, so a caller comes before what it calls.
    for library in reversed(reached):
        module.link_in(library.alone() if isinstance(library, PartLibrary) else library._get_module_for_linking(), preserve=True)


def _note_reached(libraries: list[CPUCodeLibrary], reached: dict[CPUCodeLibrary, None]) -> None:
    """Note libraries and those that they call, which come first."""
    for library in libraries:
        if library not in reached:
            if isinstance(library, PartLibrary):
                _note_reached(library._linking_libraries, reached)
            reached[library] = None


def entry_of_part() -> Any:
    """Placeholder for the entry point of a function without machine code; Numba requires a C function."""
    return dict[Any, Any]().update


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):
    """Lowering into a :class:`PartLibrary`."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower, and tell the compiler of callers about the function."""
        function = state.func_id.func
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        if function in PARTS:
            state.func_id.unique_id = digest_of_part(function)
            state.library.part, state.library.arguments = name_of_part(function), state.args
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        entry = entry_of_part()
        state.targetctx.insert_user_function(entry, state.cr.fndesc, [state.library])
        state.cr = state.cr._replace(cfunc=entry)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class KernelLowering(NativeLowering):
    """Lowering into a :class:`KernelLibrary`."""

    _name = "kernel_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower, optimise and make machine code."""
        state.library = KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().run_pass(state)


class PartCompiler(CompilerBase):
    """Numba's passes for a function that only kernels call."""

    lowering: ClassVar[type[NativeLowering]] = PartLowering

    def define_pipelines(self) -> list[Any]:
        """Numba's passes, with another lowering."""
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [(self.lowering if each is NativeLowering else each, text) for each, text in manager.passes]
        manager._finalized = False
        manager.finalize()
        return [manager]


class KernelCompiler(PartCompiler):
    """Numba's passes for a kernel."""

    lowering = KernelLowering

    def compile_extra(self, func: Any) -> Any:
        """Compile without garbage collection, as hardly any garbage arises."""
        collects = gc.isenabled()
        gc.disable()
        try:
            with type_operators_once():
                return _call_with_room(super().compile_extra, func)
        finally:
            if collects:
                gc.enable()


def _call_with_room(function: Any, argument: Any) -> Any:
    return function(argument)


# CPython stores frames in chunks of 16 KB. Deep in Numba's compiler each call allocates a chunk and frees it again, which takes a
# sixth of the time to compile. A frame with a large stack gets a chunk of its own, here of 4 MB, with space for further frames.
_call_with_room.__code__ = _call_with_room.__code__.replace(co_stacksize=270_000)
