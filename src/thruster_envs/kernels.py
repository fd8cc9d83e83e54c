"""Compiled kernels that are kept on disk, and never run by a source that has changed since.

Numba's own cache watches the file in which a kernel stands and none of the modules that are compiled into it.
Here a kernel is kept under a hash of its own module and of every module of ours that this one imports,
directly or not, whose functions and constants may stand in its machine code; under Numba's and llvmlite's
version; and under the processor. Every file carries a checksum: one that is damaged is compiled anew.

Where they are kept: in the folder that ``THRUSTER_ENVS_CACHE_DIR`` or else ``NUMBA_CACHE_DIR`` names, else in
the user's folder for caches. Where neither can be written, kernels are compiled anew in every process, and
one line says so.

Left out: kernels that take functions as arguments, or that are entered at a prompt, are compiled anew.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import os
import pickle
import re
import shutil
import sys
import sysconfig
import time
import uuid
from collections.abc import Callable
from functools import cache
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba import njit
from numba.core import event
from numba.core.caching import Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.misc.appdirs import AppDirs

#: Environment variables that name the folder of compiled kernels, the first before the second.
FOLDER_VARIABLES = ("THRUSTER_ENVS_CACHE_DIR", "NUMBA_CACHE_DIR")

_PACKAGES = ("thruster_envs", "thruster_baselines", "thruster_agents")
_SECONDS_KEPT = 30 * 24 * 3600.0
"""Kernels of an older source are removed when they were not used for so long."""


def kernel(
    function: Callable[..., Any] | None = None, /, *, nogil: bool = False, forceinline: bool = False
) -> Any:
    """Compile a function with Numba, by the rules of all kernels here, and keep it on disk.

    Division by zero gives what NumPy gives. A helper that is only called by other kernels needs no more than
    :func:`thruster_envs.helpers.njit`: it is compiled into them.

    Args:
        function: The function; left out where there are options.
        nogil: Release the interpreter lock, for kernels that several threads run at once.
        forceinline: Where other kernels call it, it becomes part of them.
    """

    def compiled(py_func: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(error_model="numpy", nogil=nogil, forceinline=forceinline)(py_func)
        if not inspect.isfunction(dispatcher):  # it is one where Numba is switched off
            dispatcher._cache = _KernelCache(py_func)  # what its option `cache` does, with another cache
        return dispatcher

    return compiled if function is None else compiled(function)


def kernel_folder() -> Path | None:
    """Where compiled kernels are kept, whether it can be written or not; None where there is no place."""
    for variable in FOLDER_VARIABLES:
        if os.environ.get(variable):
            return Path(os.environ[variable]).absolute()
    folder = Path(AppDirs(appname="thruster-envs", appauthor=False).user_cache_dir)
    return folder if folder.is_absolute() else None  # "~/..." of a user without a home


@cache
def source_hash(module: str, file: str | None = None) -> str:
    """A hash of all sources that may stand in the machine code of a module's kernels.

    Args:
        module: Its full name.
        file: Its file; None looks for it.
    """
    digest = hashlib.sha256(f"{numba.__version__} {llvmlite.__version__}".encode())
    for name, source in sorted(sources_of(module, file).items()):
        digest.update(hashlib.sha256(name.encode() + b"\0" + source).digest())
    return digest.hexdigest()[:24]


def sources_of(module: str, file: str | None = None) -> dict[str, bytes]:
    """Sources by name: of a module, and of all that it imports, directly or not.

    Of what is installed with Python or beside it, only the module's own package and ours are followed. Names
    that are imported and are not those of modules are there too, with nothing.
    """
    own = {*_PACKAGES, module.partition(".")[0]}
    sources: dict[str, bytes] = {}
    waiting = {(module, file)}
    while waiting:
        name, path = waiting.pop()
        path = path or _file_of(name)
        sources[name] = _source(path)
        package = name if path and path.endswith("__init__.py") else name.rpartition(".")[0]
        for one in _imports(sources[name]):
            full = _absolute(one, package)
            top = full.partition(".")[0]
            if full not in sources and (top in own or (top and not _installed(top))):
                waiting.add((full, None))
    return sources


def _absolute(name: str, package: str) -> str:
    """The full name of a module that is imported in a package by that name, which may be relative."""
    level = len(name) - len(name.lstrip("."))
    if level == 0:
        return name
    kept = package.split(".")[: len(package.split(".")) - level + 1]
    return ".".join([*kept, name[level:]]).rstrip(".") if package else name[level:]


@cache
def _source(path: str | None) -> bytes:
    """What stands in a file; nothing where there is none."""
    try:
        return b"" if path is None else Path(path).read_bytes()
    except OSError:
        return b""


def _file_of(module: str) -> str | None:
    """The file of a module, loaded or not; None for a name that is not that of a module."""
    top, *rest = module.split(".")
    spec = _spec(top)
    if spec is None:
        return None
    for folder in spec.submodule_search_locations or ():
        path = os.path.join(folder, *rest)
        if os.path.isdir(path):
            return os.path.join(path, "__init__.py")
        if rest and os.path.isfile(f"{path}.py"):
            return f"{path}.py"
    return None if rest else spec.origin


@cache
def _spec(top: str) -> ModuleSpec | None:
    try:
        return importlib.util.find_spec(top)
    except (ImportError, ValueError):  # not to be found, or `__main__`
        return None


@cache
def _installed(top: str) -> bool:
    """Whether a top-level module came with Python or stands where packages are installed."""
    spec = _spec(top)
    if spec is None or spec.origin is None or not os.path.isabs(spec.origin):
        return True
    path = Path(spec.origin)
    if not {"site-packages", "dist-packages"}.isdisjoint(path.parts):  # of whichever environment
        return True
    paths = sysconfig.get_paths()
    return any(path.is_relative_to(paths[name]) for name in ("stdlib", "platstdlib", "purelib", "platlib"))


_COMMENT = re.compile(rb"#[^\n]*")
_IMPORT = re.compile(
    rb"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]+))", re.MULTILINE
)
_NAME = re.compile(rb"[\w.]+")


@cache
def _imports(source: bytes) -> frozenset[str]:
    """Names that a source imports and that may be those of modules; relative ones begin with dots."""
    names: set[bytes] = set()
    for package, taken, plain in _IMPORT.findall(_COMMENT.sub(b"", source)):
        if package:
            within = package if package.endswith(b".") else package + b"."
            names |= {package} | {within + name for name in _NAME.findall(taken)}
        names |= set(_NAME.findall(plain))
    return frozenset(name.decode() for name in names)


class _KernelCache(Cache):
    """The compiled forms of one function: a file for each signature and processor."""

    def __init__(self, py_func: Callable[..., Any]) -> None:
        self._py_func = py_func
        self._module, self._file = py_func.__module__, inspect.getfile(py_func)
        self._hash = source_hash(self._module, self._file)
        self._base = f"{py_func.__qualname__}-{py_func.__code__.co_firstlineno}".replace("<locals>", "local")
        self._enabled = os.path.exists(self._file)  # what is entered at a prompt has no file

    @property
    def cache_path(self) -> str | None:
        root = kernel_folder()
        return None if root is None else str(root / f"{self._module}-{self._hash}")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What is kept for a signature and this processor, ready to run, or None."""
        target_context.refresh()
        key = self._index_key(sig, target_context.codegen())
        path = self._path(key)
        try:
            data = b"" if path is None or not self._enabled else path.read_bytes()
        except OSError:
            return None
        if hashlib.sha256(data[32:]).digest() != data[:32]:
            return None
        kept, compiled = pickle.loads(data[32:])
        return CompileResult._rebuild(target_context, *compiled) if kept == key else None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled for a signature; one line says where that is not possible."""
        if not self._enabled or data.lifted or data.library.has_dynamic_globals:
            return
        _source.cache_clear()
        source_hash.cache_clear()
        if source_hash(self._module, self._file) != self._hash:
            return  # the files are not what this process runs any more
        key = self._index_key(sig, data.codegen)
        path, content = self._path(key), dumps((key, data._reduce()))
        if path is None:
            _say_uncached("there is no home folder")
            return
        try:
            if not path.parent.is_dir():
                path.parent.mkdir(parents=True, exist_ok=True)
                _remove_old(path.parent)
            _write(path, hashlib.sha256(content).digest() + content)
        except OSError as error:
            _say_uncached(f"{path.parent.parent}: {error.strerror or error}")

    def flush(self) -> None:
        """Remove what is kept."""
        if self.cache_path is not None:
            for path in Path(self.cache_path).glob(f"{self._base}-*.nbc"):
                path.unlink(missing_ok=True)

    def _path(self, key: Any) -> Path | None:
        if self.cache_path is None:
            return None
        python = f"py{sys.version_info[0]}{sys.version_info[1]}"
        text = re.sub(r" at 0x[0-9a-f]+", "", repr(key))
        name = f"{self._base}-{python}-{hashlib.sha256(text.encode()).hexdigest()[:16]}.nbc"
        return Path(self.cache_path) / name


def _write(path: Path, data: bytes) -> None:
    """Replace a file whole."""
    new = path.with_name(f"{path.name}.{uuid.uuid4().hex}")
    try:
        new.write_bytes(data)
        os.replace(new, path)
    except OSError:
        new.unlink(missing_ok=True)
        raise


def _remove_old(folder: Path) -> None:
    """Remove what was kept for older sources of the same module and not used for a month."""
    module = folder.name.rpartition("-")[0]
    for other in folder.parent.glob(f"{module}-*"):
        if other.name.rpartition("-")[0] == module and other != folder:
            used = max((path.stat().st_atime for path in other.iterdir()), default=0.0)
            if time.time() - used > _SECONDS_KEPT:
                shutil.rmtree(other, ignore_errors=True)


@cache
def _say_uncached(reason: str) -> None:
    _say(
        f"compiled kernels cannot be kept ({reason}), so that every process compiles them anew; "
        f"{FOLDER_VARIABLES[0]} may name a folder for them"
    )


def _say(text: str) -> None:
    sys.stderr.write(f"thruster-envs: {text}\n")
    sys.stderr.flush()


class _Announcer(event.Listener):
    """Says once per process that compilation has begun."""

    said = False

    def on_start(self, event: Any) -> None:
        dispatcher = event.data["dispatcher"]
        if not self.said and dispatcher.py_func.__module__.startswith(_PACKAGES):
            self.said = True
            _say(
                "compiling kernels for this machine, once (about a minute for an environment, two for all; "
                f"kept in {kernel_folder()})"
            )

    def on_end(self, event: Any) -> None:
        """Nothing to say."""


event.register("numba:compile", _Announcer())
