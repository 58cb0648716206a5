"""What the processor can do; linear algebra is told of it before it is loaded."""

from __future__ import annotations

import os
import platform

_KERNELS = (  # OpenBLAS's names and what they need, fastest first
    ("SKYLAKEX", {"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"}),
    ("HASWELL", {"avx2", "fma"}),
)


def features() -> str:
    """Names of the processor's instruction sets, in one line."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            return next((line for line in file if line.startswith(("flags", "Features"))), "")
    except OSError:
        return platform.processor()


def prepare() -> None:
    """Set OpenBLAS's environment, where the user has not; it reads it when it is loaded.

    One thread is fastest at these sizes. OpenBLAS takes processors younger than itself for very old
    ones: Debian 12's is five to seven times as fast with the kernels that the processor's own
    instruction sets ask for.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if found := kernel(features()):
        os.environ.setdefault("OPENBLAS_CORETYPE", found)


def kernel(known: str) -> str:
    """OpenBLAS's kernel for a processor with some instruction sets; empty: its own choice."""
    return next((name for name, needed in _KERNELS if needed <= set(known.split())), "")
