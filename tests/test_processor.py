"""BLAS uses what the processor can do."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from dealib.processor import features, kernel

CODE = """
import dealib, ctypes, numpy
library = ctypes.CDLL("libblas.so.3")
name = getattr(library, "openblas_get_corename", None)
if name is not None:
    name.restype = ctypes.c_char_p
    print(name().decode())
"""


def core(**more: str) -> str:
    """OpenBLAS's kernels in a process that imports dealib; empty if its BLAS is another one."""
    clean = {k: v for k, v in os.environ.items() if k != "OPENBLAS_CORETYPE"}
    done = subprocess.run(
        [sys.executable, "-c", CODE], capture_output=True, text=True, env=clean | more
    )
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("known", "wanted"),
    [
        ("flags : fpu sse2 sse4_2 avx", ""),
        ("flags : fpu avx avx2 fma", "HASWELL"),
        ("flags : fma avx2 avx512f avx512cd avx512bw avx512dq avx512vl", "SKYLAKEX"),
        ("flags : fma avx2 avx512f avx512cd", "HASWELL"),  # Knights Landing
        ("Features : fp asimd", ""),
        ("", ""),
    ],
)
def test_kernels_follow_from_instruction_sets(known, wanted):
    assert kernel(known) == wanted


def test_openblas_takes_no_young_processor_for_an_old_one():
    if not (wanted := kernel(features())) or not (found := core()):
        pytest.skip("another processor, or another BLAS")
    assert found.upper() == wanted


def test_the_user_s_choice_stays():
    if not kernel(features()) or not core():
        pytest.skip("another processor, or another BLAS")
    assert core(OPENBLAS_CORETYPE="Nehalem").upper() == "NEHALEM"
