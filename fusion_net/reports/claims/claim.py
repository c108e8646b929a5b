"""A claim of the lesson, and what became of it."""

from dataclasses import dataclass

HOLDS, PARTLY, FAILS = "holds", "holds partly", "does not hold here"
UNDECIDED, OPEN = "undecided", "not measured yet"
VERDICTS = (HOLDS, PARTLY, FAILS, UNDECIDED, OPEN)
"""``undecided``: measured, and the interval leaves both open."""


@dataclass(frozen=True)
class Claim:
    """One row of the page. ``command`` measures it, ``measured`` says what came out (seeds, spread), ``why`` what is different
    here, or of what the claim is true."""

    text: str
    command: str
    measured: str
    verdict: str
    why: str = ""

    def __post_init__(self) -> None:
        if self.verdict not in VERDICTS:
            raise ValueError(f"claim: verdict {self.verdict!r} is none of {', '.join(VERDICTS)}")


def verdict(*holds: bool) -> str:
    """What follows from the parts of a claim: all of them, some or none."""
    return HOLDS if all(holds) else PARTLY if any(holds) else FAILS


def not_measured(text: str, command: str, path: str) -> Claim:
    """A claim whose result file is missing."""
    return Claim(text, command, f"`{path}` is not there", OPEN)
