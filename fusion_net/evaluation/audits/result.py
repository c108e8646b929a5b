"""What an audit says."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Audit:
    """``ok``: nothing was found wrong; None where the data do not suffice to judge. ``numbers`` are plain values, all that the
    audit's picture is drawn from."""

    name: str
    title: str
    verdict: str  # one line
    ok: bool | None
    numbers: dict[str, Any]
    explanation: str  # what is measured, and from when on it is wrong

    @property
    def line(self) -> str:
        """The verdict as a terminal shows it."""
        return f"{self.name}: {'not judged' if self.ok is None else 'ok' if self.ok else 'WRONG'}: {self.verdict}"
