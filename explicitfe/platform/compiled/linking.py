"""What relies on private parts of Numba: linking the functions that kernels call once, and storing compiled code safely.

Numba compiles each function to machine code by itself, and again with each function that calls it. A leaf of a material law
would so be optimised alone, with the internal force, with the step, and with the run. Here the code of what a kernel calls, its
parts, is linked, optimised and made machine code once, with the kernel, which halves the time to compile. The passes are Numba's
own; what differs is when the code of a called function is linked. Parts are stored on disk as LLVM bitcode before optimisation,
so that a kernel does not depend on whether its parts were loaded or lowered.

An import of this module fails where a release of Numba lacks what it needs; ``jit.py`` then lets Numba compile as usual.
"""

from __future__ import annotations

import gc
import hashlib
import io
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType
from typing import Any, BinaryIO, ClassVar
from weakref import WeakKeyDictionary, ref

import numba
from llvmlite import binding as llvm
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, NullCache
from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
from numba.core.compiler import CompilerBase, CompileResult, DefaultPassBuilder
from numba.core.compiler_machinery import PassManager, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import NativeLowering
from numba.core.types.functions import BaseFunction

from explicitfe.platform.compiled.cache import warn_of_storing
from explicitfe.platform.compiled.digest import digest_of_part, name_of_part

# Names that the classes here override, call or set, besides those that are imported; methods of Numba name its attributes.
_NEEDED: dict[Any, set[str]] = {
    JITCodeLibrary: {"finalize", "_finalized", "_raise_if_finalized", "_finalize_dynamic_globals", "_get_module_for_linking"},
    CPUCodeLibrary.__init__.__code__: {"_linking_libraries", "_final_module", "_shared_module"},
    Dispatcher: {"add_overload", "compile", "_compile_for_args", "enable_caching"},
    IndexDataCacheFile: {"save", "_load_index", "_load_data", "_data_path", "_open_for_write"},
    FunctionCache: {"load_overload", "save_overload", "_load_overload", "_guard_against_spurious_io_errors", "_impl_class"},
    CompilerBase: {"compile_extra", "define_pipelines"},
    PassManager: {"finalize"},
    BaseFunction: {"get_call_type"},
    BaseFunction.__init__.__code__: {"_impl_keys"},
    IndexDataCacheFile.__init__.__code__: {"_cache_path", "_index_path"},
    CompileResult: {
        "typing_context", "target_context", "entry_point", "typing_error", "type_annotation", "signature", "objectmode", "lifted",
        "fndesc", "library", "call_helper", "environment", "metadata", "reload_init", "referenced_envs",
    },
}  # fmt: skip
for _holder, _names in _NEEDED.items():
    if lacking := _names - set(getattr(_holder, "co_names", dir(_holder))):
        raise ImportError(f"Numba {numba.__version__} has no {', '.join(sorted(lacking))}")

_DIGEST_BYTES = hashlib.sha256().digest_size
_PARTS: WeakKeyDictionary[FunctionType, ref[Dispatcher]] = WeakKeyDictionary()
_OPERATORS: dict[tuple[Any, Any], tuple[Any, Any]] = {}


# ---- linking ----


class _PartLibrary(JITCodeLibrary):
    """LLVM IR of a function that only kernels call, without the functions that it calls, which are linked into the kernel.

    The name contains a digest of the sources, so that it identifies the same code in each process.
    """

    part: str | None = None
    arguments: tuple[Any, ...] = ()

    def finalize(self) -> None:
        """Link called functions that are not parts, and rename them, as Numba numbers them differently in each process."""
        self._raise_if_finalized()
        parts = [library for library in self._linking_libraries if isinstance(library, _PartLibrary) and library.part]
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

    def alone(self) -> Any:
        """LLVM module of the function without what it calls."""
        return super()._get_module_for_linking()

    def _get_module_for_linking(self) -> Any:
        """Module for a function that Numba compiles by its own passes."""
        module = self.alone().clone()
        _link(module, self._linking_libraries)
        return module


class _KernelLibrary(JITCodeLibrary):
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
        module.link_in(library.alone() if isinstance(library, _PartLibrary) else library._get_module_for_linking(), preserve=True)


def _note_reached(libraries: list[CPUCodeLibrary], reached: dict[CPUCodeLibrary, None]) -> None:
    """Note libraries and those that they call, which come first."""
    for library in libraries:
        if library not in reached:
            if isinstance(library, _PartLibrary):
                _note_reached(library._linking_libraries, reached)
            reached[library] = None


def _no_entry() -> Any:
    """Placeholder for the entry point of a function without machine code; Numba requires a C function."""
    return dict[Any, Any]().update


@register_pass(mutates_CFG=True, analysis_only=False)
class _PartLowering(NativeLowering):
    _name = "part_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower, and tell the compiler of callers about the function."""
        function = state.func_id.func
        state.library = _PartLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        if function in _PARTS:
            state.func_id.unique_id = digest_of_part(function)
            state.library.part, state.library.arguments = name_of_part(function), state.args
        state.flags.no_compile = True
        super().run_pass(state)
        state.library.finalize()
        entry = _no_entry()
        state.targetctx.insert_user_function(entry, state.cr.fndesc, [state.library])
        state.cr = state.cr._replace(cfunc=entry)
        return True


@register_pass(mutates_CFG=True, analysis_only=False)
class _KernelLowering(NativeLowering):
    _name = "kernel_lowering"

    def run_pass(self, state: Any) -> bool:
        """Lower, optimise and make machine code."""
        state.library = _KernelLibrary(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return super().run_pass(state)


class _PartCompiler(CompilerBase):
    lowering: ClassVar[type[NativeLowering]] = _PartLowering

    def define_pipelines(self) -> list[Any]:
        """Numba's passes, with another lowering."""
        manager = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes = [(self.lowering if each is NativeLowering else each, text) for each, text in manager.passes]
        manager._finalized = False
        manager.finalize()
        return [manager]


class _KernelCompiler(_PartCompiler):
    lowering = _KernelLowering

    def compile_extra(self, func: Any) -> Any:
        """Compile without garbage collection, as hardly any garbage arises."""
        collects = gc.isenabled()
        gc.disable()
        try:
            with _type_operators_once():
                return _call_with_room(super().compile_extra, func)
        finally:
            if collects:
                gc.enable()


def _call_with_room(function: Any, argument: Any) -> Any:
    return function(argument)


# CPython stores frames in chunks of 16 KB. Deep in Numba's compiler each call allocates a chunk and frees it again, which takes a
# sixth of the time to compile. A frame with a large stack gets a chunk of its own, here of 4 MB, with space for further frames.
_call_with_room.__code__ = _call_with_room.__code__.replace(co_stacksize=270_000)


@contextmanager
def _type_operators_once() -> Iterator[None]:
    """Cache the types of results of operators within this context, which one thread enters at a time.

    For each ``a + b`` Numba tries some thirty templates. A kernel has thousands of such operations, with few types.
    """
    infer = BaseFunction.get_call_type

    def infer_once(self: Any, context: Any, args: Any, kws: Any) -> Any:
        if getattr(self.key[0], "__module__", None) != "_operator":
            return infer(self, context, args, kws)
        key = self.key[0], args
        if key not in _OPERATORS:
            signature = infer(self, context, args, kws)
            _OPERATORS[key] = signature, self._impl_keys[signature.args]
        signature, implementation = _OPERATORS[key]
        self._impl_keys[signature.args] = implementation
        return signature

    BaseFunction.get_call_type = infer_once
    try:
        yield
    finally:
        BaseFunction.get_call_type = infer


# ---- storing ----


class _CheckedFiles(IndexDataCacheFile):
    """Numba's index and data files with a SHA-256 digest at their end.

    A damaged file counts as missing, and the kernel is compiled again: LLVM would end the process on changed machine code, and
    Python's pickle executes what it reads. A file that cannot be written costs only the time of the next compilation.
    """

    def save(self, key: object, data: tuple[Any, ...]) -> None:
        try:
            super().save(key, _without_bitcode(data))
        except OSError as error:
            warn_of_storing(self._cache_path, error)

    def _load_index(self) -> dict[object, str]:
        return super()._load_index() if _is_intact(self._index_path) else {}

    def _load_data(self, name: str) -> object:
        path = self._data_path(name)
        if not _is_intact(path):
            raise OSError(f"{path} is damaged")  # Numba then compiles again
        return super()._load_data(name)

    @contextmanager
    def _open_for_write(self, filepath: str) -> Iterator[BinaryIO]:
        with super()._open_for_write(filepath) as file:
            content = io.BytesIO()
            yield content
            file.write(content.getvalue())
            file.write(hashlib.sha256(content.getvalue()).digest())


class _CheckedCache(FunctionCache):
    """Numba's cache of a function, with checked files."""

    _cache_file: Any

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        plain = self._cache_file
        self._cache_file = _CheckedFiles.__new__(_CheckedFiles)
        self._cache_file.__dict__.update(plain.__dict__)

    def load_overload(self, sig: object, target_context: Any) -> Any:
        """Load compiled code without what Numba prepares before, for a tenth of a second."""
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _KernelCache(_CheckedCache):
    """Cache of a kernel."""

    def __init__(self, dispatcher: Any) -> None:
        super().__init__(dispatcher.py_func)
        self._makes_arrays = dispatcher.targetoptions["_nrt"]

    def load_overload(self, sig: object, target_context: Any) -> Any:
        """Load machine code; only a kernel that makes arrays needs what Numba prepares."""
        if self._makes_arrays:
            target_context.refresh()
        loaded = super().load_overload(sig, target_context)
        if loaded is not None:
            loaded.library._shared_module = None  # a kernel that called this one would link what _without_bitcode left
        return loaded


class _PartCache(NullCache):
    """Cache of one part. It is set up when the function is first compiled, as most processes compile nothing."""

    def __init__(self, dispatcher: Dispatcher) -> None:
        self._dispatcher = ref(dispatcher)
        _PARTS[dispatcher.py_func] = self._dispatcher

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
            return _PartFiles(named)
        except RuntimeError:  # no folder can be written, or the function stands in no file
            return NullCache()


class _PartForm(CompileResultCacheImpl):
    """Conversion of a compiled part to and from its stored form."""

    def reduce(self, cres: CompileResult) -> tuple[Any, ...]:
        """Return the bitcode, the called parts, and the description that callers need."""
        library = cres.library
        described = copy(cres.fndesc)
        described.typemap = described.calltypes = None
        called = [(each.part, each.arguments) for each in library._linking_libraries]
        identity = library.name, library.part, library.arguments
        return (identity, "part", library.alone().as_bitcode()), called, described, cres.environment, cres.signature

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> CompileResult | None:
        """Restore a function with the parts that it calls; return None if this process lacks one of them."""
        ((name, *identity), _, code), called, described, environment, signature = payload
        library = _PartLibrary(target_context.codegen(), name)
        library.part, library.arguments = identity
        library._shared_module, library._linking_libraries, library._finalized = llvm.parse_bitcode(code), [], True
        for part, arguments in called:
            dispatcher = _part_of_name(part)
            if dispatcher is None:
                return None
            dispatcher.compile(arguments)
            library._linking_libraries.append(dispatcher.overloads[arguments].library)
        known = {"typing_context": target_context.typing_context, "target_context": target_context, "entry_point": _no_entry()}
        known |= {"fndesc": described, "library": library, "environment": environment, "signature": signature}
        empty = {"objectmode": False, "lifted": (), "reload_init": (), "referenced_envs": ()}
        return CompileResult(**dict.fromkeys(CompileResult._fields) | known | empty)


def _part_of_name(name: str) -> Dispatcher | None:
    for function, dispatcher in _PARTS.items():
        if name.startswith(f"{function.__module__}.{function.__qualname__}_") and name_of_part(function) == name:
            return dispatcher()
    return None


class _PartFiles(_CheckedCache):
    _impl_class = _PartForm


def _without_bitcode(data: tuple[Any, ...]) -> tuple[Any, ...]:
    """A compilation as Numba stores it, with the names of its functions instead of LLVM's code of them.

    That code is for other kernels that inline this one. There are none, and reading it takes longer than reading machine code.
    """
    (name, kind, code), *others = data
    if kind != "object":
        return data
    machine_code, bitcode = code
    functions = [function.name for function in llvm.parse_bitcode(bitcode).functions if not function.is_declaration]
    stubs = llvm.parse_assembly("".join(f'define void @"{function}"() {{ ret void }}\n' for function in functions))
    return (name, kind, (machine_code, stubs.as_bitcode())), *others


def _is_intact(path: str) -> bool:
    try:
        content = Path(path).read_bytes()
    except OSError:
        return False
    return hashlib.sha256(content[:-_DIGEST_BYTES]).digest() == content[-_DIGEST_BYTES:]


# ---- for jit.py ----

# Options of ``numba.jit``. Wrappers that take arguments apart take long to compile: Python calls kernels only, and C calls none.
KERNEL: dict[str, Any] = {"no_cfunc_wrapper": True, "pipeline_class": _KernelCompiler}
PART: dict[str, Any] = {"no_cfunc_wrapper": True, "no_cpython_wrapper": True, "pipeline_class": _PartCompiler}


def make_part(dispatcher: Dispatcher, options: dict[str, object]) -> Dispatcher:
    """A function that kernels call; where Python calls it, as tests do, it is compiled by itself, with other options."""

    @cache
    def alone() -> Dispatcher:
        return numba.jit(dispatcher.py_func, **options)

    def note(compiled: Any) -> None:
        dispatcher.overloads[tuple(compiled.signature.args)] = compiled

    dispatcher.add_overload = note
    dispatcher._cache = _PartCache(dispatcher)
    dispatcher._compile_for_args = lambda *args, **kwargs: alone()
    return dispatcher


def store(dispatcher: Dispatcher) -> None:
    """Store the code of a kernel on disk; RuntimeError if no folder can be written."""
    dispatcher._cache = _KernelCache(dispatcher)
