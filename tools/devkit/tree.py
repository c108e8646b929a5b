"""Opening a nuScenes tree with the official devkit."""

from pathlib import Path

from nuscenes import NuScenes


def open_tree(root: Path, *, verbose: bool = False) -> NuScenes:
    """The devkit's view of a tree that has one version folder."""
    return NuScenes(version=version_of(root), dataroot=str(root), verbose=verbose)


def version_of(root: Path) -> str:
    """Name of the one version folder of a tree."""
    found = sorted(path.name for path in root.glob("v1.0-*") if path.is_dir())
    if len(found) != 1:
        raise SystemExit(f"error: {root} needs one folder v1.0-* and has {', '.join(found) or 'none'}")
    return found[0]
