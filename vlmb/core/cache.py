"""Where compiled kernels are kept: a folder for every state of the sources and versions, filled once on a machine.

numba looks for stale code at the file of the kept function alone, not at those of functions it calls. So the folder is named by
a hash of all sources of the core and of what else decides over machine code.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

from vlmb.core.lean import lean

Function = TypeVar("Function", bound=Callable[..., Any])

SOURCES = Path(__file__).parent
FOLDERS_KEPT = 4
RECENTLY = 14 * 24 * 3600.0  # [s] folders used since are kept, however many there are
ANNOUNCEMENT = "vlmb: compiling the engine, once on this machine, a minute or two"
WAITING = "vlmb: waiting for another process that is compiling the engine"


def fingerprint() -> str:
    """Hash all sources of the core, versions and the processor."""
    import numba
    import numpy as np
    from llvmlite import binding

    versions = (numba.__version__, binding.llvm_version_info, np.__version__, sys.version)
    machine = (platform.machine(), binding.get_host_cpu_name())
    digest = hashlib.sha256(repr((versions, machine)).encode())
    for source in sorted(SOURCES.rglob("*.py")):
        digest.update(source.relative_to(SOURCES).as_posix().encode() + b"\0" + source.read_bytes() + b"\0")
    return digest.hexdigest()[:20]


def candidates() -> Iterator[Path]:
    """Name folders for caches: the user's, or else one of the user's own among the temporary files."""
    asked = os.environ.get("XDG_CACHE_HOME", "")
    if Path(asked).is_absolute():
        yield Path(asked) / "vlmb"
    with contextlib.suppress(RuntimeError):  # there may be no home
        yield Path.home() / ".cache" / "vlmb"
    user = os.getuid() if hasattr(os, "getuid") else os.environ.get("USERNAME", "")
    yield Path(tempfile.gettempdir()) / f"vlmb-{user}"


def is_own(folder: Path) -> bool:
    """Say whether a folder can be written and nobody else can have put code there."""
    if not os.access(folder, os.W_OK | os.X_OK):
        return False
    if not hasattr(os, "getuid"):
        return True
    status = folder.lstat()
    return status.st_uid == os.getuid() and not status.st_mode & 0o022


@functools.cache
def folder() -> Path | None:
    """Make the folder of this state of the core, or return None where nothing can be kept."""
    name = fingerprint()
    for place in candidates():
        with contextlib.suppress(OSError):
            place.mkdir(mode=0o700, parents=True, exist_ok=True)
            if is_own(place):
                made = place / f"core-{name}"
                fresh = not made.exists()
                made.mkdir(mode=0o700, exist_ok=True)
                os.utime(made)  # in use now
                if fresh:
                    prune(place, made)
                return made
    return None


def prune(place: Path, current: Path) -> None:
    """Remove folders of other states of the core that are neither among the newest nor used recently."""
    old = sorted(
        ((path.stat().st_mtime, path) for path in place.glob("core-*") if path.is_dir() and path != current), reverse=True
    )
    for used, path in old[FOLDERS_KEPT - 1 :]:
        if time.time() - used > RECENTLY:
            shutil.rmtree(path, ignore_errors=True)


_depth = 0  # of kernels compiling one another, under numba's own lock
_announced = _waited = False


@contextlib.contextmanager
def alone(place: Path) -> Iterator[None]:
    """Let one process at a time compile into a folder; the others find there what it left."""
    global _depth, _announced
    from numba.core.compiler_lock import global_compiler_lock

    with global_compiler_lock, contextlib.ExitStack() as stack:
        if _depth == 0:
            stack.enter_context(_locked(place))
            stack.enter_context(lean())
            if not _announced and not any(place.rglob("*.nbi")):
                print(ANNOUNCEMENT, file=sys.stderr, flush=True)
                _announced = True
        _depth += 1
        try:
            yield
        finally:
            _depth -= 1


@contextlib.contextmanager
def _locked(place: Path) -> Iterator[None]:
    try:
        import fcntl
    except ImportError:  # without such locks every process compiles for itself
        yield
        return
    global _waited
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # file systems without locks
            lock = stack.enter_context((place / "lock").open("w"))
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if not _waited:
                    print(WAITING, file=sys.stderr, flush=True)
                _waited = True
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def compiled_anew(function: Function, options: dict[str, Any]) -> Function:
    """Compile a function on its first call in every process."""
    import numba
    from numba.core.compiler_lock import global_compiler_lock

    dispatcher = numba.njit(**options)(function)
    compile_now = dispatcher.compile

    def compile_lean(signature: Any) -> Any:
        with global_compiler_lock, lean():
            return compile_now(signature)

    dispatcher.compile = compile_lean
    return cast(Function, dispatcher)


def compiled(function: Function, options: dict[str, Any]) -> Function:
    """Compile a function on its first call, or load what this machine has compiled before."""
    import numba

    place, settings = folder(), cast(Any, numba.config)
    if place is None:
        return compiled_anew(function, options)
    before = settings.CACHE_DIR
    try:  # numba reads this when it decorates; other functions of the process keep their own place
        settings.CACHE_DIR = str(place)
        dispatcher = numba.njit(cache=True, **options)(function)
    finally:
        settings.CACHE_DIR = before
    compile_or_load, kept = dispatcher.compile, dispatcher._cache
    kept.load_overload = functools.partial(load, kept)
    if SOURCES in Path(function.__code__.co_filename).parents:
        share(kept, place)

    def compile_once(signature: Any) -> Any:
        with contextlib.nullcontext() if is_kept(dispatcher, signature) else alone(place):
            return compile_or_load(signature)

    dispatcher.compile = compile_once
    return cast(Function, dispatcher)


def share(kept: Any, place: Path) -> None:
    """Keep a kernel of the core where every installation of these sources finds it; numba has a folder for each of them."""
    from numba.core.caching import IndexDataCacheFile

    kept._cache_file = IndexDataCacheFile(str(place), kept._impl.filename_base, place.name)


def load(kept: Any, signature: Any, context: Any) -> Any:
    """Load the machine code of a kernel.

    numba would first get all ready to compile, and read the intermediate code beside the machine code: four fifths of what a
    process waits for that only runs. Here that is left to the time when a kernel is compiled that calls this one.
    """
    if _depth:
        return type(kept).load_overload(kept, signature, context)
    from llvmlite import binding
    from numba.core.compiler import CompileResult
    from numba.core.runtime import rtsys

    rtsys.initialize(context)
    found = kept._cache_file.load(kept._index_key(signature, context.codegen()))
    if found is None:
        return None
    (name, kind, (machine_code, intermediate)), described, *others = found
    names = described.llvm_func_name, described.llvm_cpython_wrapper_name
    entries = "\n".join(f'define void @"{entry}"() {{ ret void }}' for entry in names)
    stand_in = binding.parse_assembly(entries).as_bitcode()
    made = CompileResult._rebuild(context, (name, kind, (machine_code, stand_in)), described, *others)
    made.library._get_module_for_linking = functools.cache(lambda: binding.parse_bitcode(intermediate))
    return made


def is_kept(dispatcher: Any, signature: Any) -> bool:
    """Say whether a kernel is on the disk already: it is then loaded without waiting for a process that compiles others."""
    kept = dispatcher._cache
    return kept._index_key(signature, dispatcher.targetctx.codegen()) in kept._cache_file._load_index()
