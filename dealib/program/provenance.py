"""Commit and process of a run, for its record."""

from __future__ import annotations

import functools
import os
import platform
import subprocess
from pathlib import Path
from typing import Any


@functools.cache
def git_hash() -> str | None:
    """Commit of the checkout that dealib runs from, if it is one."""
    try:
        found = subprocess.run(
            ["git", "-C", str(Path(__file__).parent), "rev-parse", "HEAD"],
            capture_output=True,
            text=True,
            timeout=60,  # a busy machine may need seconds
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return found.stdout.strip() if found.returncode == 0 else None


def identity() -> dict[str, Any]:
    """Process and host of a run, which tell a killed run from one that is still running."""
    return {"pid": os.getpid(), "host": platform.node()}
