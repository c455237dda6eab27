"""Compiles kernels for the kernels that call them, and for Python only where Python calls them.

For each kernel Numba compiles machine code and a wrapper for Python, which unpacks every array of every record. Most kernels
are called only by other kernels, so that the wrapper, a third of the compile time, is wasted. Only this file, compiler.py and
bits.py use internal parts of Numba.
"""

from __future__ import annotations

import inspect
import logging
import multiprocessing
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numba
from numba import njit, typeof, types
from numba.core import event, sigutils
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.dispatcher import _FunctionCompiler
from numba.core.registry import CPUDispatcher

from antway.kernels.base.cache import cache_folder, source_stamp
from antway.kernels.base.compiler import quick_compiler

config: Any = numba.config
_CACHE = cache_folder()
_log = logging.getLogger("antway")


class _Watch(event.Listener):
    """Adds up the time spent compiling, and announces once that kernels are being compiled.

    One thread compiles at a time. Compilations nest, and only the outermost one is timed.
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
                _log.warning(
                    "antway: compiling kernels that are needed for the first time (antway warmup compiles all at once) ..."
                )

    def on_end(self, event: object) -> None:
        self.depth -= 1
        if not self.depth:
            self.seconds += time.perf_counter() - self.began


watch = _Watch()
event.register("numba:compile", watch)


def _jit(function: Any, **settings: Any) -> Any:
    jit: Any = njit
    return jit(no_cfunc_wrapper=True, **settings)(function)


@contextmanager
def _cache() -> Iterator[None]:
    """Keep the kernels that are defined in this context in antway's folder. Other packages keep their own."""
    before = config.CACHE_DIR
    config.CACHE_DIR = _CACHE or before
    try:
        yield
    finally:
        config.CACHE_DIR = before


class _Code(JITCodeLibrary):
    """Code of which only the functions defined in it are optimized. Numba also starts on every function it merely calls."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout
        for function in ll_module.functions:
            if not function.is_declaration:
                manager, builder = self._codegen._function_pass_manager()
                manager.run(function, builder)


class _Bitcode(_Code):
    """Bitcode that is linked into the kernels that call it. Machine code of it alone would never run."""

    def _finalize_final_module(self) -> None:
        """Do not hand the module to LLVM, which would compile machine code for it."""
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


class _Cache(FunctionCache):
    """A cache that also notices that a called kernel has changed."""

    _impl_class: Any = CompileResultCacheImpl

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        file = inspect.getfile(function)
        if os.path.isfile(file):  # a cell of a notebook is none
            self._cache_file._source_stamp = source_stamp(file)


class _InnerFiles(CompileResultCacheImpl):
    @property
    def filename_base(self) -> str:
        return f"{super().filename_base}.inner"


class _InnerCache(_Cache):
    _impl_class = _InnerFiles


class Inner(CPUDispatcher):
    """A kernel as other kernels call it: without machine code of its own and without a wrapper for Python."""

    def enable_caching(self) -> None:
        self._cache = _InnerCache(self.py_func)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        return super().get_call_template(tuple(map(_plain, args)), {name: _plain(kind) for name, kind in kws.items()})

    def compile(self, sig: Any) -> Any:
        codegen = self.targetctx.codegen()
        with quick_compiler(), _compiling_to(_Bitcode, codegen):
            before = codegen.set_env
            codegen.set_env = lambda name, env: None  # setting one would compile the surrounding code
            try:
                return super().compile(sig)
            finally:
                codegen.set_env = before

    def is_compiled(self, args: Any) -> bool:
        """Tell whether it has been compiled for arguments of these types, in this process or on disk."""
        sig, _ = sigutils.normalize_signature(args)
        key = self._cache._index_key(args, self.targetctx.codegen())
        return sig in self.overloads or key in self._cache._cache_file._load_index()


class Kernel(CPUDispatcher):
    """A kernel as Python calls it."""

    settings: dict[str, Any]  # of Numba's
    shared: bool  # whether kernels call it with the same types as Python does; it is compiled for them first

    @cached_property
    def inner(self) -> Inner:
        """The kernel as kernels call it, which a process that finds what it needs on disk never asks for."""
        inner: Inner = _jit(self.py_func, no_cpython_wrapper=True, **self.settings)
        inner.__class__ = Inner
        with _cache():
            inner.enable_caching()
        return inner

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.inner)

    def compile(self, sig: Any) -> Any:
        with quick_compiler(), _compiling_to(_Code, self.targetctx.codegen()):
            entry_point = super().compile(sig)  # then set the environments that Inner left unset
        args, _ = sigutils.normalize_signature(sig)
        compiled = self.overloads[tuple(args)]
        for env in compiled._find_referenced_environments():
            compiled.codegen.set_env(env.env_name, env)
        return entry_point


class _Compiler(_FunctionCompiler):
    """Compiles a kernel for Python as a call of the one already compiled for kernels, which is much faster."""

    kernel: Kernel

    def _get_implementation(self, args: Any, kws: Any) -> Any:
        if not (self.kernel.shared or self.kernel.inner.is_compiled(args)):
            return self.py_func
        names = ", ".join(inspect.signature(self.py_func).parameters)
        found: dict[str, Any] = {"inner": self.kernel.inner, "__name__": self.py_func.__module__}
        exec(f"def {self.py_func.__name__}({names}):\n    return inner({names})", found)
        return found[self.py_func.__name__]


def for_kernels_and_python(function: Any, settings: dict[str, Any], shared: bool) -> Kernel:
    """Return `function` as a kernel with these settings of Numba's, cached on disk; `shared` as in `Kernel`."""
    kernel: Kernel = _jit(function, **settings)
    with _cache():
        kernel._cache = _Cache(function)
    kernel.__class__, kernel.settings, kernel.shared = Kernel, settings, shared
    kernel._compiler.__class__, kernel._compiler.kernel = _Compiler, kernel
    return kernel


def compiled_for(function: Any, sample: tuple[object, ...]) -> Any:
    """Return the kernel `function` compiled for arguments of the types in `sample`."""
    return function.compile(tuple(map(typeof, sample)))


def _plain(kind: Any) -> Any:
    """Return int64 for shorter integers and integer literals, else the type itself.

    Otherwise Numba would compile a called kernel once more for each of them, at a second or two each.
    """
    if isinstance(kind, types.IntegerLiteral) or kind in (types.int32, types.int16, types.int8):
        return types.int64
    return kind
