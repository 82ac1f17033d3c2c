"""One thing that was checked of a robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """One row of the report: ``value`` must not exceed ``limit``.

    Attributes:
        name: What was measured.
        value: What was found.
        limit: The most that is allowed.
        unit: Of both.
        place: File, and key in it, to change where the check fails.
        detail: What is expected there, and what was found instead.
    """

    name: str
    value: float
    limit: float
    unit: str
    place: str
    detail: str

    @property
    def passed(self) -> bool:
        """Whether the value is within the limit (NaN is not)."""
        return bool(self.value <= self.limit)

    @property
    def problem(self) -> str:
        """The line for a check that fails."""
        return f"{self.place}: {self.detail}"


def sound(checks: Iterable[Check]) -> bool:
    """Whether all checks pass."""
    return all(check.passed for check in checks)
