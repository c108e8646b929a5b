"""What a check found: a figure beside the limit that it has to keep."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """``figure`` against ``limit``: at least it, or at most it. ``count`` says how many cases the figure rests on; with fewer
    than ``need`` it is left open, which does not fail. ``case`` says which of several like ones it is: a radar and an age."""

    what: str
    figure: float
    sense: Literal[">=", "<="]
    limit: float
    count: int
    unit: str = ""
    case: str = ""
    need: int = 1

    @property
    def is_open(self) -> bool:
        """Whether there were too few cases to say."""
        return self.count < self.need

    @property
    def passed(self) -> bool:
        """Whether the limit is kept."""
        if self.is_open:
            return True
        return self.figure >= self.limit if self.sense == ">=" else self.figure <= self.limit

    def strain(self) -> float:
        """How near the figure is to its limit: 1 at it."""
        high, low = (self.limit, self.figure) if self.sense == "<=" else (self.figure, self.limit)
        return low / high if high > 0 else 0.0

    def line(self) -> str:
        """One row of the report."""
        name = f"{self.what} [{self.case}]" if self.case else self.what
        if not self.count:
            return f"  --   {name}: no case in this tree"
        if self.is_open:
            return f"  --   {name}: too few cases ({self.count} of {self.need})"
        verdict = "  ok  " if self.passed else " FAIL "
        return f"{verdict} {name}: {self.figure:.4g} {self.unit} ({self.sense} {self.limit:.4g}; {self.count} cases)"


def report(findings: list[Finding]) -> Iterator[str]:
    """Each failure, and of like ones that passed only the one that is nearest to its limit."""
    groups: dict[str, list[Finding]] = {}
    for finding in findings:
        groups.setdefault(finding.what, []).append(finding)
    for like in groups.values():
        failed = [finding for finding in like if not finding.passed]
        said = [finding for finding in like if not finding.is_open]
        yield from (finding.line() for finding in failed)
        if not failed:
            more = f"; {len(like) - 1} more, {len(like) - len(said)} of them with too few" if len(like) > 1 else ""
            yield max(said or like, key=Finding.strain).line() + more


def share(what: str, hits: int, of: int, limit: float, case: str = "", need: int = 1) -> Finding:
    """The finding that at least ``limit`` of all cases are as they should be."""
    return Finding(what, hits / of if of else 0.0, ">=", limit, int(of), case=case, need=need)


def none_of(what: str, wrong: list[str], of: int) -> Finding:
    """The finding that no case is wrong; the first that is goes into the text."""
    return Finding(what + (f" (first: {wrong[0]})" if wrong else ""), len(wrong), "<=", 0, of)
