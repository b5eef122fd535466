"""Programs traced once, kept on disk beside the compiled ones.

Tracing a rollout and its derivatives takes JAX longer than reading a compiled program back: a study that is looked at
again, or another of the same layout, starts at once. Without a folder for compiled programs nothing is kept and
`shelved` is `jax.jit`.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import pickle
from collections.abc import Callable, Sequence
from functools import cache, update_wrapper
from pathlib import Path
from threading import Lock
from typing import Any

import equinox
import jax
import jax.numpy as jnp
import numpy as np
from jax import export
from jax.core import Tracer

from backend.environment import many_programs
from backend.simulate.kernel import call as kernel
from backend.source import source_digest

SUFFIX = ".traced"
DIGEST = hashlib.sha256().digest_size
MOST = 200  # programs kept; those not asked for the longest go first
OURS = [export.DisabledSafetyCheck.custom_call(name) for name in kernel.TARGETS]

Program = Callable[..., Any]


class Shelved:
    """A pure function of arrays in pytrees that returns arrays in tuples, compiled per layout.

    Called as `jax.jit(function, static_argnames=static)`; static arguments are part of the layout.
    """

    def __init__(self, function: Callable[..., Any], static: Sequence[str] = ()):
        self.plain = jax.jit(function, static_argnames=tuple(static))
        self.function, self.static = function, tuple(static)
        self.signature = inspect.signature(function)
        self._ready: dict[Any, Program | None] = {}
        self._lock = Lock()
        update_wrapper(self, function)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        """As the function itself."""
        given = self.signature.bind(*args, **kwargs).arguments
        fixed = {name: given[name] for name in self.static}
        leaves, tree = jax.tree.flatten({k: v for k, v in given.items() if k not in fixed})
        folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
        if folder is None or any(isinstance(leaf, Tracer) for leaf in leaves):
            return self.plain(*args, **kwargs)
        leaves = [jnp.asarray(leaf) for leaf in leaves]
        layout = tree, tuple(fixed.items()), tuple((leaf.shape, leaf.dtype) for leaf in leaves)
        with self._lock:  # threads that ask for one program wait for it instead of tracing it again
            if layout not in self._ready:
                self._ready[layout] = self._read_or_trace(Path(folder), tree, fixed, leaves)
            found = self._ready[layout]
        return self.plain(*args, **kwargs) if found is None else found(*leaves)

    def _read_or_trace(self, folder: Path, tree: Any, fixed: dict, leaves: list) -> Program | None:
        """The program; None where its layout has no name that another process would find."""
        try:
            name = self._name(tree, fixed, leaves)
        except (pickle.PicklingError, TypeError, AttributeError):
            return None
        if many_programs():
            jax.clear_caches()  # what is asked for again is read from disk
        path = folder / f"{name}{SUFFIX}"
        if (kept := _read(path)) is None:
            kept = self._trace(tree, fixed, leaves)
            _write(path, kept)
        return jax.jit(export.deserialize(bytearray(kept)).call)

    def _trace(self, tree: Any, fixed: dict, leaves: list) -> bytes:
        def flat(*leaves):
            return self.function(**jax.tree.unflatten(tree, leaves), **fixed)

        return bytes(export.export(jax.jit(flat), disabled_checks=OURS)(*leaves).serialize())

    def _name(self, tree: Any, fixed: dict, leaves: list) -> str:
        shapes = [(leaf.shape, str(leaf.dtype)) for leaf in leaves]
        what = (self.function.__module__, self.function.__qualname__, _layout(tree), _named(fixed), shapes)
        return hashlib.sha256(_made_from() + pickle.dumps(what)).hexdigest()


def shelved(*static: str) -> Callable[[Callable[..., Any]], Shelved]:
    """Decorator: `@shelved("addresses")` for `jax.jit` with `addresses` static."""
    return lambda function: Shelved(function, static)


def _layout(tree: Any) -> Any:
    """What a tree is made of, by names that every process gives alike."""
    data = tree.node_data()
    return _named(data) if data is None else (_named(data[0]), _named(data[1]), [_layout(c) for c in tree.children()])


def _named(value: Any) -> Any:
    """Types by name, arrays by content, functions refused: a name does not tell what they hold."""
    match value:
        case type():
            return f"{value.__module__}.{value.__qualname__}"
        case dict():
            return [(_named(k), _named(v)) for k, v in value.items()]
        case tuple() | list():
            return [type(value).__name__, *map(_named, value)]
        case np.ndarray():
            return value.shape, str(value.dtype), value.tobytes()
        case _ if callable(value):
            raise TypeError(f"{value!r} has no lasting name")
    return value


@cache
def _made_from() -> bytes:
    """Of all that a traced program depends on beside its layout: our source, the packages and the kernel."""
    versions = jax.__version__, equinox.__version__, np.__version__, jax.default_backend(), jnp.zeros(()).dtype.name
    return repr((source_digest(), *versions, kernel.available())).encode()


def _read(path: Path) -> bytes | None:
    """A program as it was written; None where it is not there, or not whole."""
    try:
        content = path.read_bytes()
        path.touch()
    except OSError:
        return None
    digest, kept = content[:DIGEST], content[DIGEST:]
    return kept if hashlib.sha256(kept).digest() == digest else None


def _write(path: Path, kept: bytes) -> None:
    """All or nothing, so that another process never reads half; a full disk costs time later, nothing else."""
    part = path.with_suffix(f".{os.getpid()}.part")
    try:
        part.write_bytes(hashlib.sha256(kept).digest() + kept)
        part.replace(path)
        shelf = sorted(path.parent.glob(f"*{SUFFIX}"), key=lambda p: p.stat().st_mtime)
        for old in shelf[:-MOST]:
            old.unlink(missing_ok=True)
    except OSError:
        part.unlink(missing_ok=True)
