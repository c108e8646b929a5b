"""How a generated data set was made, as its manifest says."""

import shlex
from pathlib import Path
from typing import Any

from fusion_net.common.cli.command_line import as_override


def generating_command(root: Path, manifest: dict[str, Any]) -> str:
    """What to type to make the data set in ``root``, or to go on with it; "" where the manifest does not say.

    The manifest keeps the command without its folder, so that a copy or a moved data set tells its own. A shard lies in the
    folder that the command names.
    """
    command = manifest.get("command", "")
    folder = root.parent if manifest.get("shard") else root
    return f"{command} {shlex.quote(f'data.root={as_override(folder)}')}" if command else ""


def whole_command(root: Path, manifest: dict[str, Any]) -> str:
    """The same of a whole data set, where ``root`` is a shard of it: in one process and folder it comes out equal."""
    command = generating_command(root, manifest)
    if not manifest.get("shard"):
        return command
    program, words = shlex.split(command)[:3], shlex.split(command)[3:]  # python -m data_gen
    of_shards = ("-m", "--multirun", "shard=", "hydra/")
    return shlex.join([*program, *(word for word in words if not word.startswith(of_shards))])
