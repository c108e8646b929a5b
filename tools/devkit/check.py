"""Opens a tree with the official nuScenes devkit, lists its samples and draws one of each sensor with boxes.

Run it inside the environment that setup.sh makes:

    .venv-devkit/bin/python tools/devkit/check.py --root data/nano --out devkit_check
"""

import argparse
import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud, RadarPointCloud


def check(root: Path, sample_index: int, out: Path) -> None:
    """Loads every table, lists samples, reads multi-sweep clouds and writes one picture a modality."""
    tree = NuScenes(version=_version_of(root), dataroot=str(root), verbose=True)
    if not 0 <= sample_index < len(tree.sample):
        raise SystemExit(f"error: --sample {sample_index} is not in 0..{len(tree.sample) - 1}")
    for sample in tree.sample[:3]:
        scene = tree.get("scene", sample["scene_token"])
        print(f"{scene['name']} ({scene['description']}) {sample['token']}: {len(sample['anns'])} boxes")
    sample = tree.sample[sample_index]
    tree.list_sample(sample["token"])
    out.mkdir(parents=True, exist_ok=True)
    drawn = set()
    for channel, token in sample["data"].items():
        modality = tree.get("sample_data", token)["sensor_modality"]
        if modality == "lidar":
            cloud, times = LidarPointCloud.from_file_multisweep(tree, sample, channel, "LIDAR_TOP", nsweeps=3)
            print(
                f"{channel}: {cloud.nbr_points()} points in up to 3 sweeps, ages {times.min():.3f} to {times.max():.3f} s"
            )
        elif modality == "radar":
            cloud, _ = RadarPointCloud.from_file_multisweep(tree, sample, channel, "LIDAR_TOP", nsweeps=3)
            print(f"{channel}: {cloud.nbr_points()} returns in up to 3 sweeps")
        if modality not in drawn:
            path = out / f"{modality}.png"
            tree.render_sample_data(
                token, with_anns=True, axes_limit=50, out_path=str(path), verbose=False, underlay_map=False
            )
            print(f"wrote {path}")
            drawn.add(modality)
    speeds = [tree.box_velocity(token) for token in sample["anns"]]
    print(f"velocities of {len(speeds)} boxes by finite differences, fastest {_fastest(speeds):.1f} m/s")


def _fastest(velocities: list) -> float:
    return max(((v[0] ** 2 + v[1] ** 2) ** 0.5 for v in velocities if v[0] == v[0]), default=0.0)


def _version_of(root: Path) -> str:
    found = sorted(path.name for path in root.glob("v1.0-*") if path.is_dir())
    if len(found) != 1:
        raise SystemExit(f"error: {root} needs one folder v1.0-* and has {', '.join(found) or 'none'}")
    return found[0]


def main() -> None:
    """Checks a tree; any refusal of the devkit ends with its message."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--root", type=Path, required=True, help="nuScenes tree")
    parser.add_argument("--sample", type=int, default=0, help="which sample to draw, by its place in the table")
    parser.add_argument("--out", type=Path, default=Path("devkit_check"), help="folder for the pictures")
    arguments = parser.parse_args()
    try:
        check(arguments.root, arguments.sample, arguments.out)
    except (AssertionError, KeyError, FileNotFoundError, ValueError) as error:
        sys.exit(f"error: the devkit refused {arguments.root}: {type(error).__name__}: {error}")


if __name__ == "__main__":
    main()
