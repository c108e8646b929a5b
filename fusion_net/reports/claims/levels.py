"""Claims about where to fuse: from the results of ``python -m fusion_net.reports.levels``.

The orders are judged there, each pair of neighbours by its interval; here they become rows.
"""

from typing import Any

from fusion_net.reports.claims.claim import FAILS, HOLDS, OPEN, PARTLY, UNDECIDED, Claim, not_measured, verdict
from fusion_net.reports.claims.results import Results

COMMAND = "python -m fusion_net.reports.levels"
FILE = ("levels", "levels.json")
ORDERS = {
    "information": "Early fusion keeps the most information, mid much, late the least",
    "graceful dropout": "Losing a sensor: late fusion degrades most gracefully, then mid, early poorly",
    "silent death": "The same where the sensor dies silently, its readings blank",
    "misalignment": "Miscalibration: early fusion is fragile, mid moderate, late robust",
    "shaking": "The same where mounts shake from frame to frame",
    "clocks": "Sensors out of time: early fusion is fragile, mid moderate, late robust",
    "corruptions": "Over all faults late fusion is the most robust, early the least",
    "another LiDAR": "Modularity: a sensor can be swapped without retraining in late fusion, less in mid, least in early",
}
"""By the beginning of the claim in the file."""
WORDS = {"holds": HOLDS, "holds partly": PARTLY, "does not hold": FAILS, "undecided": UNDECIDED, "not measured": OPEN}
COSTS = "Early fusion needs the most bandwidth where the sensors meet, late the least"
FAINT = "Late fusion loses what each sensor alone sees too faintly: far from the car it falls behind"
RETRAIN = "Swapping a sensor means retraining one part in late fusion, and the whole network in early fusion"


def claims(results: Results) -> list[Claim]:
    """All of them."""
    doc = results.read(*FILE)
    if doc is None:
        path = results.shown(*FILE)
        return [not_measured(text, COMMAND, path) for text in (*ORDERS.values(), FAINT, COSTS, RETRAIN)]
    orders = {start: _order_of(doc, start) for start in ORDERS}
    return [
        *(_order(text, orders[start], doc) for start, text in ORDERS.items()),
        _faint(doc),
        _costs(doc),
        _retraining(doc),
    ]


def _order_of(doc: dict[str, Any], start: str) -> dict[str, Any] | None:
    return next((each for each in doc.get("orders", ()) if each["claim"].startswith(start)), None)


def _order(text: str, order: dict[str, Any] | None, doc: dict[str, Any]) -> Claim:
    if order is None or order["verdict"] not in WORDS or not order["values"]:
        lacking = ", ".join((order or {}).get("missing", ())) or "any level"
        return Claim(text, COMMAND, f"no figure of {lacking} in `docs/results/{'/'.join(FILE)}`", OPEN)
    values = ", ".join(f"{level} {_figure(value)}" for level, value in order["values"].items())
    seeds = (
        len(doc.get("seeds", ()))
        if order["claim"].startswith(("information", "graceful"))
        else len(doc.get("cell_seeds", ()))
    )
    pairs = "; ".join(
        f"{pair['pair']} {pair['difference']:+.3f} [{pair['ci95'][0]:+.3f}, {pair['ci95'][1]:+.3f}]"
        for pair in order["pairs"]
    )
    what = order["claim"].partition(": ")[2] or order["claim"]
    return Claim(text, COMMAND, f"{what}: {values}; {seeds} seed{'s' * (seeds != 1)}", WORDS[order["verdict"]], pairs)


def _figure(value: dict[str, Any]) -> str:
    low, high = value["ci95"]
    return f"{value['value']:.2f} [{low:.2f}, {high:.2f}]" if None not in (value["value"], low, high) else "-"


def _faint(doc: dict[str, Any]) -> Claim:
    """mAP of late fusion as a share of that of mid fusion, near and far."""
    ranges = {level: doc.get("conditions", {}).get(level, {}).get("range", {}) for level in ("mid", "late")}
    groups = [group for group in ranges["late"] if group in ranges["mid"]]
    if len(groups) < 2:
        return Claim(FAINT, COMMAND, f"not by range for both levels in `docs/results/{'/'.join(FILE)}`", OPEN)
    mAP = {level: [each[group]["mAP"]["C+L+R"] for group in groups] for level, each in ranges.items()}
    share = [late / max(mid, 1e-9) for late, mid in zip(mAP["late"], mAP["mid"], strict=True)]
    cells = ", ".join(
        f"{group}: mid {mid:.2f}, late {late:.2f}"
        for group, mid, late in zip(groups, mAP["mid"], mAP["late"], strict=True)
    )
    return Claim(
        FAINT, COMMAND, f"mAP {cells}", verdict(share[-1] < share[0] - 0.05, share[-1] < 1),
        f"Late as a share of mid: {100 * share[0]:.0f} % nearest, {100 * share[-1]:.0f} % farthest.",
    )  # fmt: skip


def _costs(doc: dict[str, Any]) -> Claim:
    """Bytes a frame that arrive where sensors first meet."""
    merged = {level: sum(costs.get("bytes_merged", {}).values()) for level, costs in doc.get("costs", {}).items()}
    if set(merged) != {"early", "mid", "late"} or not all(merged.values()):
        return Claim(COSTS, COMMAND, f"not for all levels in `docs/results/{'/'.join(FILE)}`", OPEN)
    measured = ", ".join(f"{level} {merged[level] / 1e3:,.0f} kB" for level in ("early", "mid", "late"))
    return Claim(
        COSTS, COMMAND, f"{measured} a frame", verdict(merged["early"] > merged["mid"], merged["mid"] > merged["late"]),
        "The images that enter are a small part of what the maps of features hold." if merged["mid"] > merged["early"] else "",
    )  # fmt: skip


def _retraining(doc: dict[str, Any]) -> Claim:
    """Share of the parameters that hang on each sensor."""
    shares = {
        level: {name: count / costs["parameters"] for name, count in costs["hanging"].items()}
        for level, costs in doc.get("costs", {}).items()
        if costs.get("hanging")
    }
    if set(shares) != {"early", "mid", "late"}:
        return Claim(RETRAIN, COMMAND, f"not for all levels in `docs/results/{'/'.join(FILE)}`", OPEN)
    measured = "; ".join(
        f"{level}: {', '.join(f'{name} {100 * share:.0f} %' for name, share in shares[level].items())}"
        for level in ("early", "mid", "late")
    )
    late, early = (max(shares[level].values()) for level in ("late", "early"))
    return Claim(RETRAIN, COMMAND, f"parameters that hang on a sensor: {measured}", verdict(late < 0.5, early > 0.8))
