"""Instruction sets of the processor, from which OpenBLAS's kernels are chosen."""

from __future__ import annotations

import os
import platform

_KERNELS = (  # OpenBLAS's names and the instruction sets they need, fastest first
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
    """Set the environment variables that OpenBLAS reads when it is loaded, unless they are set.

    One thread is fastest at these sizes. OpenBLAS uses its slowest kernels on processors that are
    newer than itself: Debian 12's is five to seven times as fast with kernels that are chosen by
    instruction sets.
    """
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    if found := kernel(features()):
        os.environ.setdefault("OPENBLAS_CORETYPE", found)


def kernel(known: str) -> str:
    """OpenBLAS's name of the best kernel; empty: its own choice.

    Args:
        known: The processor's instruction sets, as of `features`.
    """
    return next((name for name, needed in _KERNELS if needed <= set(known.split())), "")
