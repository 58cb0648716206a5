"""An observer for tests."""

from collections.abc import Callable
from typing import Any


class At:
    """Does something at a step, or raises it.

    Args:
        step: Number of the step.
        what: To be called, or an error to be raised.
    """

    def __init__(self, step: int, what: Callable[[], Any] | BaseException) -> None:
        self.step, self.what = step, what

    def start(self, simulation: Any) -> None:
        """See `Observer`."""

    def see(self, state: Any) -> None:
        """See `Observer`."""
        if state.row["step"] != self.step:
            return
        if isinstance(self.what, BaseException):
            raise self.what
        self.what()

    def stop(self, error: BaseException | None) -> None:
        """See `Observer`."""
