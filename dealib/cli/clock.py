"""The time at which the process began, for the timings of a run."""

import time

STARTED = time.perf_counter()
