"""Matrix products and loops over many rows: as fast as the numpy and the processor at hand allow.

The numpy of Blender's own builds comes without a BLAS: there `@` is a plain loop, several times slower than `einsum`,
whose inner loop is vectorised. So the first product tries both, which takes about a millisecond.
"""

import ctypes
import functools
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from .container import Floats

CHUNK = 1024  # rows at a time: the temporaries of one chunk stay in the processor's cache
MOST_THREADS = 8  # Python itself runs in one at a time; more only wait for it
TRIALS = 5
# The functions' names in the builds of OpenBLAS for numpy 2 and 1, with 64-bit and 32-bit sizes.
OPENBLAS_NAMES = tuple(
    f"{prefix}openblas_{{}}_num_threads{suffix}" for prefix in ("scipy_", "") for suffix in ("64_", "")
)

Result = TypeVar("Result")
Product = Callable[[Floats, Floats], Floats]


def by_blas(x: Floats, weight: Floats) -> Floats:
    """x weight^T as numpy's linear algebra has it."""
    return x @ weight.T


def by_loops(x: Floats, weight: Floats) -> Floats:
    """x weight^T without a BLAS: rows times rows, both contiguous."""
    return np.einsum("ij,kj->ik", x, weight)


def product(x: Floats, weight: Floats) -> Floats:
    """x [n, inputs] times the transpose of weight [outputs, inputs]: [n, outputs]."""
    return _fastest()(x, weight)


@functools.cache
def _fastest() -> Product:
    """Which of the two is faster here, on products of the size that a model needs."""
    x, weight = np.ones((256, 128), np.float32), np.ones((128, 128), np.float32)

    def seconds(function: Product) -> float:
        times = []
        for _ in range(TRIALS):
            start = time.perf_counter()
            function(x, weight)
            times.append(time.perf_counter() - start)
        return min(times)

    with _one_blas_thread():
        return min((by_blas, by_loops), key=seconds)


def over_chunks(count: int, work: Callable[[slice], Result]) -> list[Result]:
    """What `work` returns for each slice of `count` rows, in order; numpy lets several run at a time.

    The threads live no longer than the call: Blender wants none at other times. A BLAS that has threads of its own must
    rest them meanwhile, or both wait for each other; where it cannot be told, there is one thread here.
    """

    def quietly(part: slice) -> Result:
        with np.errstate(over="ignore", invalid="ignore"):  # numbers that overflow are the caller's to find
            return work(part)

    parts = list(_chunks(count))
    threads = min(len(parts), _processors(), MOST_THREADS)
    if threads < 2 or (_openblas() is None and _fastest() is by_blas):
        return [quietly(part) for part in parts]
    with ThreadPoolExecutor(threads) as pool, _one_blas_thread():
        return list(pool.map(quietly, parts))


def _chunks(count: int) -> Iterator[slice]:
    return (slice(start, start + CHUNK) for start in range(0, count, CHUNK))


@dataclass(frozen=True)
class OpenBlas:
    """The library that the numpy of package registries brings: how many threads it uses can be told and changed."""

    get_threads: Callable[[], int]
    set_threads: Callable[[int], object]


@contextmanager
def _one_blas_thread() -> Iterator[None]:
    """Let the BLAS compute in the thread that calls it, for a while, where it can be told."""
    blas = _openblas()
    if blas is None:
        yield
        return
    before = blas.get_threads()
    blas.set_threads(1)
    try:
        yield
    finally:
        blas.set_threads(before)


@functools.cache
def _openblas() -> OpenBlas | None:
    """The OpenBLAS inside numpy's package, or None."""
    package = Path(np.__file__).parent
    for path in (*package.parent.glob("numpy.libs/*openblas*"), *package.glob(".dylibs/*openblas*")):
        try:
            library = ctypes.CDLL(str(path))  # loaded already: this only finds it
        except OSError:
            continue
        for name in OPENBLAS_NAMES:
            if hasattr(library, name.format("set")):
                return OpenBlas(getattr(library, name.format("get")), getattr(library, name.format("set")))
    return None


def _processors() -> int:
    """How many processors this program may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
