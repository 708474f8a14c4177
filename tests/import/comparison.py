"""A table of differences between what was expected and what was found, each beside its limit."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Row:
    """One quantity: how often it was compared, its largest difference, the limit."""

    unit: str
    limit: float
    n: int = 0
    worst: float = 0.0
    where: str = ""


@dataclass
class Comparison:
    """Collects differences by quantity and prints them as one table."""

    rows: dict[str, Row] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def add(self, name: str, difference: object, limit: float, unit: str, where: str) -> None:
        """Counts a difference (a number or an array); NaN is the worst there is. `(told) ..` never fails."""
        values = np.atleast_1d(np.asarray(difference, dtype=float)).ravel()
        row = self.rows.setdefault(name, Row(unit, limit))
        row.n += values.size
        if values.size == 0:
            return
        worst = float(np.inf if np.isnan(values).any() else np.abs(values).max())
        if worst > row.worst or not row.where:
            row.worst, row.where = worst, where

    def equal(self, name: str, found: object, expected: object, where: str) -> None:
        """Counts something that must be the same."""
        row = self.rows.setdefault(name, Row("equal", 0))
        row.n += 1
        if found != expected:
            row.worst += 1
            row.where = where
            self.fault(f"{name} at {where}: found {str(found)[:120]}, expected {str(expected)[:120]}")

    def fault(self, sentence: str) -> None:
        """Something that no number says."""
        self.faults.append(sentence)

    def note(self, sentence: str) -> None:
        """Something to know that is no fault."""
        if sentence not in self.notes:
            self.notes.append(sentence)

    def finish(self) -> int:
        """Prints the table; 0 if all is within its limit, else 1."""
        print(f"{'quantity':<44} {'compared':>9} {'worst':>12} {'limit':>9}  {'unit':<6} verdict")
        bad = len(self.faults)
        for name, row in self.rows.items():
            good = (row.worst <= row.limit and row.n > 0) or name.startswith("(told)")
            bad += not good
            verdict = "ok" if good else f"DIFFERS at {row.where}" if row.n else "NOTHING COMPARED"
            print(f"{name:<44} {row.n:>9} {row.worst:>12.3g} {row.limit:>9.3g}  {row.unit:<6} {verdict}")
        for sentence in self.notes:
            print(f"note: {sentence}")
        for sentence in self.faults[:20]:
            print(f"FAULT: {sentence}")
        if len(self.faults) > 20:
            print(f"FAULT: and {len(self.faults) - 20} more")
        print("all equal" if bad == 0 else f"{bad} differ")
        return int(bad > 0)


def angle_between(one: float, other: float) -> float:
    """The smallest difference of two angles, radians."""
    return float(abs((one - other + np.pi) % (2 * np.pi) - np.pi))


def rotation_angle(one: np.ndarray, other: np.ndarray) -> float:
    """The angle of the rotation between two rotation matrices, radians; exact for small ones."""
    return float(np.linalg.norm(one - other) / np.sqrt(2))
