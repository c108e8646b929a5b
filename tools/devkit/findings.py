"""What a check found: a figure beside the limit that it has to keep."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """``figure`` against ``limit``: at least it, or at most it. ``count`` says how many cases the figure rests on; without
    any it is left open, which passes."""

    what: str
    figure: float
    sense: Literal[">=", "<="]
    limit: float
    count: int
    unit: str = ""

    @property
    def passed(self) -> bool:
        """Whether the limit is kept."""
        if not self.count:
            return True
        return self.figure >= self.limit if self.sense == ">=" else self.figure <= self.limit

    def line(self) -> str:
        """One row of the report."""
        if not self.count:
            return f"  --   {self.what}: no case in this tree"
        verdict = "  ok  " if self.passed else " FAIL "
        return f"{verdict} {self.what}: {self.figure:.4g} {self.unit} ({self.sense} {self.limit:g}; {self.count} cases)"


def share(what: str, hits: int, of: int, limit: float) -> Finding:
    """The finding that at least ``limit`` of all cases are as they should be."""
    return Finding(what, hits / of if of else 0.0, ">=", limit, int(of))


def none_of(what: str, wrong: list[str], of: int) -> Finding:
    """The finding that no case is wrong; the first that is goes into the text."""
    return Finding(what + (f" (first: {wrong[0]})" if wrong else ""), len(wrong), "<=", 0, of)
