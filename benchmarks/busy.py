"""What one busy process beside it costs a training run: ``python -m benchmarks.busy [data=data/nano] [seconds=20]``.

``train.py`` itself on a generated data set, its fusion stage, quiet and beside a process that counts for ever; with as many
threads as torch takes, with ``trainer.threads=auto``, which watches for others, and with a process of one thread on each core
that takes its part of the batch. samples/s, the first seconds left out.
"""

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from fusion_net.nuscenes.absent import refuse_no_data

BUSY = [sys.executable, "-c", "while True: pass"]
TRAIN = """
import train
from fusion_net.training.callbacks import MetricsCSV
MetricsCSV.__init__.__kwdefaults__["every"] = 1
train.main()
"""
"""``train.py`` with a row in metrics.csv for every step, which is read here while it runs."""
BATCH = 8
WARM_UP = 10.0
"""Seconds in the loop that are not measured: kernels are made, and the watch looks twice before it acts."""
LONGEST_START = 180.0
KEYS = ("data", "seconds")


def samples_per_second(data: Path, how: list[str], seconds: float) -> float:
    """Of a run of its own, between the first and the last rows of metrics.csv that fall into the time that is measured."""
    with tempfile.TemporaryDirectory(dir=".") as folder:
        steps = [
            f"trainer.{stage}_steps={count}" for stage, count in (("camera", 0), ("camera_only", 0), ("fusion", 10**6))
        ]
        script = Path(folder) / "train_with_rows.py"  # a file, since a second process is started from it
        script.write_text(TRAIN, encoding="utf-8")
        command = [sys.executable, script.name, "name=busy", f"data.root={data.resolve()}", *how, *steps]
        command += ["trainer.validate_every=1000000", "trainer.save_every=1000000"]
        environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
        run = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, start_new_session=True)
        try:
            return BATCH * _steps_per_second(run, Path(folder) / "runs/busy/metrics.csv", seconds)
        finally:
            os.killpg(run.pid, signal.SIGKILL)  # the processes that it started, too
            run.wait()


def _steps_per_second(run: subprocess.Popen, metrics: Path, seconds: float) -> float:
    """Looks at the last row's step again and again."""
    started, seen = time.perf_counter(), [(0.0, 0)]
    begun: float | None = None
    while begun is None or time.perf_counter() < begun + WARM_UP + seconds:
        if run.poll() is not None:
            raise SystemExit("error: the training ended; its message stands above")
        if begun is None and time.perf_counter() - started > LONGEST_START:
            raise SystemExit(f"error: no step within {LONGEST_START:.0f} s")
        rows = metrics.read_text(encoding="utf-8").splitlines()[1:] if metrics.exists() else []
        if rows and (step := int(rows[-1].split(",")[0])) != seen[-1][1]:
            now = time.perf_counter()
            begun = begun or now
            if now > begun + WARM_UP or len(seen) == 1:
                seen.append((now, step))
        time.sleep(0.02)
    (first, before), (last, after) = seen[2], seen[-1]
    return (after - before) / (last - first)


def main(arguments: list[str]) -> None:
    """Prints the table and, last, one JSON object."""
    given = dict(argument.partition("=")[::2] for argument in arguments)
    if unknown := set(given) - set(KEYS):
        raise SystemExit(f"error: unknown {', '.join(sorted(unknown))}; there are {', '.join(KEYS)}")
    data, seconds = Path(given.get("data", "data/nano")), float(given.get("seconds", 20))
    try:
        refuse_no_data(data)
    except ValueError as error:
        raise SystemExit(f"error: {error}") from None
    cores = len(os.sched_getaffinity(0))
    together = [f"trainer.devices={cores}", "trainer.threads=1", f"trainer.batch_size={BATCH // cores}"]
    ways = {name: [f"trainer.threads={name}", f"trainer.batch_size={BATCH}"] for name in (str(cores), "1", "auto")}
    ways |= {f"{cores} processes": together}
    rates: dict[str, dict[str, float]] = {"quiet": {}, "busy": {}}
    for load, found in rates.items():
        beside = subprocess.Popen(BUSY) if load == "busy" else None
        try:
            for name, how in ways.items():
                found[name] = samples_per_second(data, how, seconds)
        finally:
            if beside is not None:
                beside.kill()
    print(
        f"fusion stage, batch of {BATCH}, {cores} cores; samples/s\n{'trainer.threads':18}{'quiet':>8}{'busy':>8}{'kept':>8}"
    )
    kept = {name: rates["busy"][name] / rates["quiet"][str(cores)] for name in rates["quiet"]}
    for name in kept:
        print(f"{name:18}{rates['quiet'][name]:8.1f}{rates['busy'][name]:8.1f}{kept[name]:8.0%}")
    print(json.dumps({"cores": cores, "samples_per_s": rates, "kept_of_quiet": kept}))


if __name__ == "__main__":
    main(sys.argv[1:])
