"""Opening a nuScenes tree with the official devkit."""

from pathlib import Path

from nuscenes import NuScenes
from project import nuscenes_format


def open_tree(root: Path, *, verbose: bool = False) -> NuScenes:
    """The devkit's view of a tree that has one version folder."""
    return NuScenes(version=version_of(root), dataroot=str(root), verbose=verbose)


def version_of(root: Path) -> str:
    """Name of the one version folder of a tree."""
    found = sorted(path.name for path in root.glob(f"{nuscenes_format.VERSION_PREFIX}*") if path.is_dir())
    if len(found) != 1:
        wanted = f"one folder {nuscenes_format.VERSION_PREFIX}*"
        raise SystemExit(f"error: {root} needs {wanted} and has {', '.join(found) or 'none'}")
    return found[0]
