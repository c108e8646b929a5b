"""What a result depends on beside its settings: the command, the code, the versions and the processor."""

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

from fusion_net.common.cli.typed import typed_command


def environment() -> dict[str, Any]:
    """As it is noted beside every result."""
    import torch  # here, so that what is said of a folder needs none

    return {
        "command": typed_command(),
        "git": git_revision(),
        "python": platform.python_version(),
        "torch": torch.__version__,
        "lightning": version("lightning"),  # to import it takes seconds
        "numpy": version("numpy"),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
    }


def git_revision() -> str:
    """Commit of the source tree, with "+" when it has changes; "" outside a repository."""
    here = Path(__file__).resolve().parent

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", *arguments], cwd=here, capture_output=True, text=True, check=False)
        return done.stdout.strip()

    revision = git("rev-parse", "--short", "HEAD")
    return revision + ("+" if revision and git("status", "--porcelain", "--untracked-files=no") else "")


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()
