"""How Numba compiles kernels here: what a kernel calls is optimised and made machine code once, with the kernel.

Numba compiles each function to machine code by itself, and again with each function that calls it. A leaf of a material law
would so be optimised alone, with the internal force, with the step, and with the run. Once is enough, which halves the time to
compile a kernel. The passes are Numba's own; what differs is when the code of a called function is linked.
"""

from __future__ import annotations

import gc
from typing import Any, ClassVar

from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import register_pass
from numba.core.typed_passes import NativeLowering


class PartLibrary(JITCodeLibrary):
    """The code of a function that only kernels call, as it was lowered. What it calls is linked into the kernel."""

    def finalize(self) -> None:
        """Leave the rest to the kernel."""
        self._raise_if_finalized()
        self._finalized = True

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


@register_pass(mutates_CFG=True, analysis_only=False)
class PartLowering(NativeLowering):
    """Lowering into a :class:`PartLibrary`."""

    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower, and tell the compiler of callers about the function."""
        state.library = PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        entry = dict[Any, Any]().update  # stands for the function, which has no machine code; Numba asks for a function of C
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
        """Compile without searching for garbage, of which there is next to none: a twentieth of the time."""
        collects = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()
