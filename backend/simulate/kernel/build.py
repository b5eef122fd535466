"""Where the compiled kernel lies, and how it is made: one shared library beside its C++ files.

The library's name holds what it was made from (source, jax's version, this processor, the compiler), so that one made
from anything else is never loaded.
"""

import hashlib
import os
import platform
import shutil
import subprocess
from pathlib import Path

import jax

FOLDER = Path(__file__).parent
SOURCES = tuple(sorted(FOLDER.glob("*.cpp")))
HEADERS = tuple(sorted(FOLDER.glob("*.h")))
NAME = "kernel"
FLAGS = ("-O3", "-std=c++17", "-ffp-contract=fast", "-fPIC", "-shared", "-pthread", "-Wall", "-Wextra")
NATIVE = "-march=native"  # not every compiler knows it


class NoCompiler(Exception):
    """This machine has no C++ compiler; the engine runs without the kernel."""


def compiler() -> str:
    """Path of a C++ compiler: $CXX, or the first of c++, g++, clang++.  Raises NoCompiler."""
    names = [os.environ["CXX"]] if os.environ.get("CXX") else ["c++", "g++", "clang++"]
    for found in map(shutil.which, names):
        if found:
            return found
    raise NoCompiler(f"no C++ compiler ({', '.join(names)}) on the path")


def library() -> Path | None:
    """The library made from these sources for this jax and this processor; None where none was built."""
    return next(iter(sorted(FOLDER.glob(f"{_stem()}-*.so"))), None)


def build() -> Path:
    """Compile the kernel where that has not been done, and remove older ones.

    Raises NoCompiler, or CalledProcessError where the compiler refuses.
    """
    with_compiler = compiler()
    version = subprocess.run([with_compiler, "--version"], capture_output=True, text=True, check=True).stdout
    target = FOLDER / f"{_stem()}-{_digest(version, *FLAGS)}.so"
    if not target.exists():
        made = target.with_suffix(f".{os.getpid()}.part")  # a run that begins meanwhile never sees half a library
        include = ["-isystem", jax.ffi.include_dir()]
        try:
            for native in ([NATIVE], []):
                command = [with_compiler, *FLAGS, *native, *include, "-o", str(made), *map(str, SOURCES)]
                outcome = subprocess.run(command, capture_output=True, text=True)
                if outcome.returncode == 0:
                    break
            outcome.check_returncode()
            made.replace(target)
        finally:
            made.unlink(missing_ok=True)
    for other in FOLDER.glob("*.so"):
        if other != target:
            other.unlink()
    return target


def _stem() -> str:
    texts = [file.read_text(encoding="utf-8") for file in (*HEADERS, *SOURCES)]
    return f"{NAME}-{_digest(*texts, jax.__version__, _processor())}"


def _processor() -> str:
    """Machine and instruction sets: a library for this processor may hold instructions that another lacks."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine() + platform.processor()
    told = sorted({line for line in lines if line.startswith(("model name", "flags", "Features", "CPU part"))})
    return "\n".join([platform.machine(), *told])


def _digest(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:12]
