"""Variants of a network compared: means over seeds, and differences with intervals over seeds and scenes.

A run keeps its mAP on R resamples of the validation scenes (:mod:`fusion_net.evaluation.bootstrap`), and all runs use the same
resamples. A draw of the two-level bootstrap takes one of them, and as many seeds as there are, with replacement. Differences
are paired by both: the same scenes, the same seeds.
"""

import difflib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion_net.common.cli.config_files import CONFIGS
from fusion_net.evaluation.bootstrap import over_scenes
from fusion_net.reports.ablation.jobs import Job
from fusion_net.reports.run_result import SCALE
from fusion_net.reports.tables import NAMES, name_of

DRAWS = 4000
WHOLE = ("NDS", "mATE", "mASE", "mAOE", "mAVE")
"""Figures of the row with every sensor that a network has."""

OTHERS = "results=null leaves out committed ones"


def compare(jobs: Sequence[Job], *, reference: str | None = None) -> dict[str, Any]:
    """The document that tables and charts show. ``reference``: the variant that the others are compared with, by a part of
    its name; the first where it is None. ValueError when runs cannot be compared."""
    done = [job for job in jobs if job.result is not None]
    if not done:
        raise ValueError(f"no job has a result yet; {len(jobs)} are without, such as {jobs[0].name}: {jobs[0].why}")
    refuse_other_data({job.name: job.result for job in done if job.result is not None}, advice=OTHERS)
    order = list(dict.fromkeys(job.variant for job in jobs))
    shared = set.intersection(*map(set, order)) if len(order) > 1 else set(order[0])
    labels = {variant: ", ".join(text for text in variant if text not in shared) or "default" for variant in order}
    variants = [_variant(labels[key], [job for job in jobs if job.variant == key], jobs) for key in order]
    against = _reference([v for v in variants if v["seeds"]], reference)
    results = {labels[key]: {j.seed: j.result for j in done if j.variant == key} for key in order}
    for variant in variants:
        variant["difference"] = {
            name: difference(results[variant["label"]], results[against["label"]], name)
            for name in variant["mAP"]
            if name in against["mAP"] and variant is not against
        }
    return {"shared": sorted(shared), "reference": against["label"], "variants": variants, **_provenance(done)}


def two_level(values: NDArray[np.float64], rng: np.random.Generator, draws: int = DRAWS) -> NDArray[np.float64]:
    """(D,) means over seeds of ``values`` (N, R), of N seeds on R resamples of the scenes, each on one resample and N seeds
    drawn with replacement. Deviations of the seeds are widened by sqrt(N / (N - 1)), which the plain bootstrap of so few falls
    short by. With one seed the draws tell of the scenes only."""
    seeds, resamples = values.shape
    on = rng.integers(resamples, size=draws)
    drawn = values[rng.integers(seeds, size=(draws, seeds)), on[:, None]].mean(axis=1)
    center = values[:, on].mean(axis=0)
    return center + (drawn - center) * np.sqrt(seeds / max(seeds - 1, 1))


def _variant(label: str, own: Sequence[Job], everyone: Sequence[Job]) -> dict[str, Any]:
    """Means and spread over the seeds that have a result; the others by name."""
    found = {job.seed: job.result for job in own if job.result is not None}
    without = {job.seed: f"{job.name}: {job.why}" for job in own if job.result is None and job.seed not in found}
    never = sorted({job.seed for job in everyone} - found.keys() - without.keys())
    missing = without | dict.fromkeys(never, "no such job")
    results = [found[seed] for seed in sorted(found)]
    rows = [{name_of(row["sensors"]): row for row in result["rows"]} for result in results]
    whole = name_of(results[0]["encoders"]) if results else ""
    shown = NAMES if whole == NAMES[0] else tuple(name for name in NAMES if name == whole)
    return {
        "label": label,
        "n": len(found),
        "seeds": sorted(found),
        "missing": {str(seed): why for seed, why in sorted(missing.items())},
        "sensors": whole,
        "mAP": {
            name: spread([row[name]["mAP"] for row in rows]) | {"ci95": _interval(_resampled(results, name), results)}
            for name in shown
        },
        **{name: spread([row[whole][name] for row in rows]) for name in WHOLE},
        "decoy_AUC": spread([_decoy_auc(result, whole) for result in results]),
        "minutes": spread([result["minutes"] for result in results]),
        "steps": spread([result["steps"] for result in results]),
    }


def spread(values: Sequence[float | None]) -> dict[str, Any]:
    """Mean and standard deviation (of a sample, so of two at least); None where a value is not known."""
    known = [value for value in values if value is not None]
    if not known or len(known) < len(values):
        return {"mean": None, "sd": None, "values": list(values)}
    sd = float(np.std(known, ddof=1)) if len(known) > 1 else None
    return {"mean": float(np.mean(known)), "sd": sd, "values": known}


def difference(ours: Mapping[int, Any], theirs: Mapping[int, Any], name: str) -> dict[str, Any] | None:
    """mAP of the row ``name`` of our results minus that of theirs, over the seeds that both have, with its interval."""
    seeds = sorted(ours.keys() & theirs.keys())
    if not seeds:
        return None
    values = [
        next(row["mAP"] for row in result["rows"] if name_of(row["sensors"]) == name)
        for side in (ours, theirs)
        for result in (side[seed] for seed in seeds)
    ]
    mean = float(np.mean(values[: len(seeds)]) - np.mean(values[len(seeds) :]))
    sides = [_resampled([side[seed] for seed in seeds], name) for side in (ours, theirs)]
    return {"mean": mean, "ci95": _interval(sides[0] - sides[1], [*ours.values()]), "n": len(seeds)}


def _interval(values: NDArray[np.float64], results: Sequence[Mapping[str, Any]]) -> list[float] | None:
    """Of ``values`` (N, R) of N seeds on R resamples of the scenes that all results were scored on."""
    scenes = results[0]["scored"]["scenes"] if results else 0
    return over_scenes(two_level(values, np.random.default_rng(0)), scenes)


def _resampled(results: Sequence[dict[str, Any]], name: str) -> NDArray[np.float64]:
    """(N, R) mAP of each run on each resample."""
    return np.array([result["mAP_resampled"][name] for result in results]) / SCALE


def _decoy_auc(result: dict[str, Any], sensors: str) -> float | None:
    """Mean over the classes that decoys imitate."""
    rows = [row for kind in result["decoys"] for row in kind["rows"] if name_of(row["sensors"]) == sensors]
    known = [row["AUC"] for row in rows if row["AUC"] is not None]
    return float(np.mean(known)) if known else None


def _reference(variants: Sequence[dict[str, Any]], wanted: str | None) -> dict[str, Any]:
    if wanted is None:
        return variants[0]
    exact = [variant for variant in variants if variant["label"] == wanted]
    near = exact or [variant for variant in variants if wanted in variant["label"]]
    if len(near) != 1:
        labels = [variant["label"] for variant in near or variants]
        alike = difflib.get_close_matches(wanted, [part for label in labels for part in [label, *label.split(", ")]], 1)
        meant = f"; did you mean {alike[0]}?" if alike and not near else ";"
        raise ValueError(
            f"reference={wanted} is in the names of {len(near)} variants{meant} write more of one of: {'; '.join(labels)}"
        )
    return near[0]


def refuse_other_data(results: Mapping[str, Mapping[str, Any]], *, advice: str) -> None:
    """Only scores on the same scenes, resampled alike, can be paired. ``results`` by name; ``advice``: what to do else."""
    kinds: dict[str, str] = {}
    for name, result in results.items():
        scored, resampled = result["scored"], next(iter(result["mAP_resampled"].values()))
        hashes = "+".join(each[:12] for each in scored["data"])
        kinds.setdefault(
            f"{scored['num_samples']} samples of {scored['split']} of {hashes}, {len(resampled)} resamples", name
        )
    if len(kinds) > 1:
        (one, first), (other, second) = list(kinds.items())[:2]
        raise ValueError(f"{first} was scored on {one}, {second} on {other}: they cannot be compared; {advice}")


def _provenance(done: Sequence[Job]) -> dict[str, Any]:
    """Where and on what the jobs ran."""
    results = [job.result for job in done if job.result is not None]

    def different(name: str) -> list[str]:
        return sorted({str(result.get(name)) for result in results})

    first = results[0]["scored"]
    data = {name: first[name] for name in ("data", "split", "num_samples", "scenes")}
    common = {
        key: value
        for key, value in results[0]["settings"].items()
        if all(result["settings"].get(key) == value for result in results)
    }
    return {
        "scored": data,
        "settings": common,
        "beside": _beside(results),
        "git": different("git"),
        "processor": different("processor"),
    }


def _beside(results: Sequence[dict[str, Any]]) -> dict[str, list[str]]:
    """Settings that differ although no job was asked to: of a recipe that was changed between two of them. A group of settings
    that is swept (``view_transform``) may change the model in many places."""
    asked = {text.lstrip("+").partition("=")[0] for result in results for text in result.get("overrides") or ()}
    places = tuple(f"{name}." for name in asked)
    if any((CONFIGS / name).is_dir() for name in asked):
        places += ("model.",)
    keys = sorted({key for result in results for key in result["settings"]} - asked)
    found = {key: sorted({str(result["settings"].get(key, "default")) for result in results}) for key in keys}
    return {key: values for key, values in found.items() if len(values) > 1 and not key.startswith(places)}
