"""The lesson's catalogue of five failures: each provoked, and whether its audit catches it."""

from dataclasses import dataclass

from fusion_net.evaluation.audits.ablation import judge_subsets
from fusion_net.evaluation.audits.association import judge_gate
from fusion_net.reports.claims.claim import OPEN, Claim, not_measured, verdict
from fusion_net.reports.claims.results import DEMO, Results

WIDE_GATE = 12
"""Metres."""
FAULTS = "faults"
"""Folder of the audits of provoked failures, one folder each."""


@dataclass(frozen=True)
class Failure:
    """A failure, the override that provokes it, and the audit that is to catch it."""

    text: str
    audit: str
    folder: str
    command: str


FAILURES = (
    Failure(
        "Failure 1, ghosts: the calibration overlay catches a sensor that is turned",
        "calibration",
        "camera_rotation_2",
        "python eval.py run=runs/demo audits=calibration fault=camera_rotation fault.severity=2",
    ),
    Failure(
        "Failure 2, wrong range: the audit of depth against LiDAR catches a camera that knows no depth",
        "depth",
        "depth_uniform",
        "python eval.py run=runs/demo audits=depth depth_source=uniform",
    ),
    Failure(
        "Failure 3, imbalance: the per-modality ablation catches a network that collapses without one sensor",
        "ablation",
        "depth_x_dropout",
        "python train.py experiment=small name=no_dropout modality_dropout=0;"
        " python eval.py run=runs/no_dropout audits=ablation",
    ),
    Failure(
        "Failure 4, domain shift: the evaluation per condition catches what the average hides",
        "conditions",
        "clear_only",
        "python train.py name=clear_only grid=nano model.bev_channels=32 data.root=data/clear;"
        " python eval.py run=runs/clear_only data.root=data/nano audits=conditions",
    ),
    Failure(
        "Failure 5, mis-association: the association audit catches a gate that merges different objects",
        "association",
        DEMO,
        f"python eval.py run=runs/demo audits=association audit_gate={WIDE_GATE}",
    ),
)


def claims(results: Results) -> list[Claim]:
    """All five; the audit of the sound run must stay silent where the failure is one that it does not have."""
    own = {"ablation": _imbalance, "association": _association}
    return [own[failure.audit](results) if failure.audit in own else _claim(results, failure) for failure in FAILURES]


def _claim(results: Results, failure: Failure) -> Claim:
    folder = f"{FAULTS}/{failure.folder}"
    audit, sound = results.audit(failure.audit, of=folder), results.audit(failure.audit)
    if audit is None:
        return not_measured(failure.text, failure.command, results.shown(folder, "audits", f"{failure.audit}.json"))
    if audit["ok"] is None:
        return Claim(failure.text, failure.command, audit["verdict"], OPEN)
    if sound is None or sound["ok"] is None:
        return Claim(failure.text, failure.command, audit["verdict"], verdict(not audit["ok"]))
    silent = f"The sound run: {'ok' if sound['ok'] else 'wrong'}: {sound['verdict']}"
    return Claim(failure.text, failure.command, audit["verdict"], verdict(not audit["ok"], bool(sound["ok"])), silent)


def _imbalance(results: Results) -> Claim:
    """The audit's rule on the drop tables of the ablation's runs without dropout, and of the default run."""
    failure = FAILURES[2]
    folder = results.root / "runs" / failure.folder
    tables = [
        results.read("runs", failure.folder, path.name) for path in sorted(folder.glob("*modality_dropout-0.0*.json"))
    ]
    sound = results.read(DEMO, "result.json")
    if not tables or sound is None:
        missing = ("runs", failure.folder) if not tables else (DEMO, "result.json")
        return not_measured(failure.text, failure.command, results.shown(*missing))
    caught = [judge_subsets(table["rows"], table["encoders"]) for table in tables]
    said, ok, _ = judge_subsets(sound["rows"], sound["encoders"])
    wrong = [words for words, fine, _ in caught if not fine]
    return Claim(
        failure.text,
        failure.command,
        f"caught in {len(wrong)} of {len(caught)} runs without dropout; the first: {caught[0][0]}",
        verdict(len(wrong) == len(caught), ok),
        f"The default run: {'ok' if ok else 'wrong'}: {said}",
    )


def _association(results: Results) -> Claim:
    """The audit's rule on a gate that is too wide and on the default one: its file holds the counts of all gates."""
    failure = FAILURES[4]
    audit = results.audit(failure.audit)
    if audit is None:
        return not_measured(failure.text, failure.command, results.shown(DEMO, "audits", f"{failure.audit}.json"))
    said, ok = judge_gate(audit["numbers"], WIDE_GATE)
    sound = f"The default gate: {'ok' if audit['ok'] else 'wrong'}: {audit['verdict']}"
    return Claim(failure.text, failure.command, said, verdict(not ok, bool(audit["ok"])), sound)
