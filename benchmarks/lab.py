"""How long the failure lab takes to answer: ``python -m benchmarks.lab run=runs/demo [ANSWERS]``.

Somebody plays with the page: from state to state one random control is set to a random value, in random scenes and keyframes.
An answer is all that happens between the control and what the page is sent: files read or rendered, the network, the score, the
pictures, the view that is open. Answers for which the generator had to render are counted apart. Beside the time on the
clock stands the processor's: what a free core would take.
"""

import json
import random
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from fusion_lab.engine.answers import Lab
from fusion_lab.engine.detectors import offered
from fusion_lab.engine.state import RANGES, LabState, Offer, first_state
from fusion_lab.engine.studio import RENDERED, open_studio
from fusion_lab.views.screen import draw

CONTROLS = (
    "scene", "frame", "condition", "condition", "severity", "camera", "lidar", "radar", "turned", "degrees", "centimetres",
    "late", "milliseconds", "depth", "beams", "threshold", "view", "offset", "confidence", "level",
)  # fmt: skip
"""What is played with, the weather twice as often as the rest."""
TARGET_MS = 500.0


def changed(state: LabState, offer: Offer, rng: random.Random) -> LabState:
    """The state after one control was set."""
    name = rng.choice(CONTROLS)
    choices = offer.choices(name)
    if choices is None:
        low, high, _ = RANGES[name]
        value: Any = RANGES[name].nearest(rng.uniform(low, high))
        value = int(value) if name == "severity" else value
    else:
        value = rng.choice(choices)
    state = replace(state, **{name: value})
    return replace(state, severity=min(state.severity, offer.conditions[state.condition]))


def measure(lab: Lab, root: Path, answers: int) -> dict[str, list[tuple[float, float]]]:
    """Milliseconds on the clock and of the processor of each answer, with and without rendering."""
    rng, state = random.Random(1), first_state(lab.offer)
    took: dict[str, list[tuple[float, float]]] = {"rendered": [], "read": []}
    for _ in range(answers):
        state = changed(state, lab.offer, rng)
        files = _files(root)
        began, worked = time.perf_counter(), time.process_time()
        draw(lab, state)
        ms = 1e3 * (time.perf_counter() - began), 1e3 * (time.process_time() - worked)
        took["rendered" if _files(root) > files else "read"].append(ms)
    return took


def _files(root: Path) -> int:
    return sum(1 for _ in (root / RENDERED).rglob("*.*"))


def main() -> None:
    """Prints a table and, last, the figures as JSON."""
    given = dict(each.split("=", 1) for each in sys.argv[1:] if "=" in each)
    answers = next((int(each) for each in sys.argv[1:] if each.isdigit()), 300)
    trained = offered([given["run"]] if "run" in given else [], "best")
    with tempfile.TemporaryDirectory() as folder:
        rig = next(iter(trained.values())).cfg.data.name
        began = time.perf_counter()
        studio = open_studio(Path(folder), rig=rig, scenes=4, keyframes=8, seed=4)
        lab = Lab(studio, trained)
        lab.warm_up()
        start = time.perf_counter() - began
        took = measure(lab, studio.root, answers)
    everything = took["rendered"] + took["read"]
    figures: dict[str, float] = {"first_start_s": round(start, 1), "answers": len(everything)}
    print(f"first start, scenes generated and everything compiled or loaded: {start:.1f} s")
    print(f"{'answers':24} {'count':>6} {'':>10} {'median ms':>10} {'95 % ms':>8} {'longest ms':>11}")
    for name, values in (
        ("all", everything),
        ("weather rendered first", took["rendered"]),
        ("files there", took["read"]),
    ):
        for kind, column in (("clock", 0), ("processor", 1)):
            if values:
                middle, most, longest = np.quantile(np.array(values)[:, column], (0.5, 0.95, 1.0)).tolist()
                print(f"{name:24} {len(values):6} {kind:>10} {middle:10.0f} {most:8.0f} {longest:11.0f}")
                key = f"{name.split()[0]}_{kind}"
                figures |= {f"{key}_median_ms": round(middle, 1), f"{key}_p95_ms": round(most, 1)}
    print(f"target: {TARGET_MS:.0f} ms")
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
