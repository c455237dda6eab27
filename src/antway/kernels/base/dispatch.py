"""How kernels are compiled twice: once for kernels that call them, and for Python only where Python calls them.

Numba compiles for each kernel machine code and what Python needs to call it, which unpacks every array of every record. Most
kernels are called by other kernels alone: that is compiled for nothing, and takes a third of the time. All that reaches into
Numba's own parts is in this file, in compiler.py and in bits.py.
"""

from __future__ import annotations

import inspect
import logging
import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numba
from numba import njit, typeof, types
from numba.core import event, sigutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.dispatcher import _FunctionCompiler
from numba.core.registry import CPUDispatcher

from antway.kernels.base.cache import cache_folder
from antway.kernels.base.compiler import quick_compiler

config: Any = numba.config
_CACHE = cache_folder()
_log = logging.getLogger("antway")


class _Watch(event.Listener):
    """Adds up the time that compiling takes, and says once that kernels are being compiled.

    One thread compiles at a time, and what a kernel calls is compiled while it is: the outermost compilation counts.
    """

    def __init__(self) -> None:
        self.depth, self.began, self.seconds, self.announced = 0, 0.0, 0.0, False

    def on_start(self, event: object) -> None:
        if not self.depth:
            self.began = time.perf_counter()
        self.depth += 1
        if not self.announced:
            self.announced = True
            if multiprocessing.parent_process() is None and not os.environ.get("ANTWAY_QUIET"):
                _log.warning("antway: compiling the kernels; this happens once and is kept on disk (see antway warmup) ...")

    def on_end(self, event: object) -> None:
        self.depth -= 1
        if not self.depth:
            self.seconds += time.perf_counter() - self.began


watch = _Watch()
event.register("numba:compile", watch)


class _Code(JITCodeLibrary):
    """Code whose functions are optimized: Numba also sets out to for each function that it calls, which is most of them."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                manager, builder = self._codegen._function_pass_manager()
                manager.run(function, builder)


class _Bitcode(_Code):
    """Code that becomes a part of the kernels that call it: kept as such, for machine code of it alone would never run."""

    def _finalize_final_module(self) -> None:
        """Leave the module out of what is compiled: LLVM makes machine code of all modules that it has been given."""
        self._finalize_dynamic_globals()
        self._finalized = True

    def serialize_using_object_code(self) -> Any:
        return self.serialize_using_bitcode()


@contextmanager
def _compiling_to(library: type[_Code], codegen: Any) -> Iterator[None]:
    before = codegen._library_class
    codegen._library_class = library
    try:
        yield
    finally:
        codegen._library_class = before


class _InnerFiles(CompileResultCacheImpl):
    @property
    def filename_base(self) -> str:
        return f"{super().filename_base}.inner"


class _InnerCache(FunctionCache):
    _impl_class = _InnerFiles


class Inner(CPUDispatcher):
    """A kernel as other kernels call it: without machine code of its own and what Python needs to call it."""

    def enable_caching(self) -> None:
        self._cache = _InnerCache(self.py_func)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return super().get_call_template(tuple(map(_plain, args)), {name: _plain(kind) for name, kind in kws.items()})

    def compile(self, sig: Any) -> Any:
        codegen = self.targetctx.codegen()
        with quick_compiler(), _compiling_to(_Bitcode, codegen):
            before = codegen.set_env
            codegen.set_env = lambda name, env: None  # to set one compiles all around it
            try:
                return super().compile(sig)
            finally:
                codegen.set_env = before

    def is_compiled(self, args: Any) -> bool:
        """Tell whether it is compiled for arguments of these types, here or on disk."""
        sig, _ = sigutils.normalize_signature(args)
        key = self._cache._index_key(args, self.targetctx.codegen())
        return sig in self.overloads or key in self._cache._cache_file._load_index()


class Kernel(CPUDispatcher):
    """A kernel as Python calls it."""

    inner: Inner
    shared: bool  # whether kernels call it wherever Python does, so that it is compiled for them first

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.inner)

    def compile(self, sig: Any) -> Any:
        with quick_compiler(), _compiling_to(_Code, self.targetctx.codegen()):
            entry_point = super().compile(sig)  # and set what Inner left unset
        args, _ = sigutils.normalize_signature(sig)
        compiled = self.overloads[tuple(args)]
        for env in compiled._find_referenced_environments():
            compiled.codegen.set_env(env.env_name, env)
        return entry_point


class _Compiler(_FunctionCompiler):
    """Compiles for Python what other kernels call already as a call of that, which takes a fraction of the time."""

    kernel: Kernel

    def _get_implementation(self, args: Any, kws: Any) -> Any:
        if not (self.kernel.shared or self.kernel.inner.is_compiled(args)):
            return self.py_func
        names = ", ".join(inspect.signature(self.py_func).parameters)
        found: dict[str, Any] = {"inner": self.kernel.inner, "__name__": self.py_func.__module__}
        exec(f"def {self.py_func.__name__}({names}):\n    return inner({names})", found)
        return found[self.py_func.__name__]


def for_kernels_and_python(function: Any, settings: dict[str, Any], shared: bool) -> Kernel:
    """Return `function` to be compiled with these settings of Numba's and kept on disk, if `shared` for kernels first."""
    jit: Any = njit
    before = config.CACHE_DIR
    config.CACHE_DIR = before or _CACHE  # for this kernel alone: other packages keep theirs where they did
    try:
        compiled: Any = jit(cache=True, no_cfunc_wrapper=True, **settings)(function)
        compiled.__class__, compiled.shared = Kernel, shared
        compiled._compiler.__class__, compiled._compiler.kernel = _Compiler, compiled
        compiled.inner = jit(no_cfunc_wrapper=True, no_cpython_wrapper=True, **settings)(function)
        compiled.inner.__class__ = Inner
        compiled.inner.enable_caching()
    finally:
        config.CACHE_DIR = before
    kernel: Kernel = compiled
    return kernel


def compiled_for(function: Any, sample: tuple[object, ...]) -> Any:
    """Return the kernel `function` as compiled for arguments of the types of these."""
    return function.compile(tuple(map(typeof, sample)))


def _plain(kind: Any) -> Any:
    """Return the type for which a kernel is compiled that another one calls: int64 for shorter integers and written numbers.

    Numba would compile it once more for each, at a second or two.
    """
    if isinstance(kind, types.IntegerLiteral) or kind in (types.int32, types.int16, types.int8):
        return types.int64
    return kind
