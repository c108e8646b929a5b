"""Where a picture is to be written, checked before it is drawn."""

from pathlib import Path


def picture_file(out: str) -> Path:
    """The path, its folder made. ValueError when its end names no format of pictures."""
    path = Path(out)
    if path.suffix not in (".png", ".jpg", ".pdf", ".svg"):
        raise ValueError(f"out={out} is no picture; end it with .png")
    path.parent.mkdir(parents=True, exist_ok=True)
    return path
