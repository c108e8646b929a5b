"""The folder of a nuScenes data set and its JSON tables: found, read, and checked before anything uses a value.

A value that is not what the format says is named with its table, its record and its field.
"""

import json
from pathlib import Path
from typing import Any

from fusion_net.common.cli.command_line import command_line
from fusion_net.common.nuscenes_format import MANIFEST_FILE, VERSION_PREFIX
from fusion_net.nuscenes.origin import generating_command
from fusion_net.nuscenes.table_fields import FIELDS, OPTIONAL, Field, Record, Tables

LONGEST = 80
"""Characters of a wrong value that a message shows."""


def version_folder(root: Path, version: str | None = None) -> Path:
    """The folder ``v1.0-*`` of tables of a data set that is whole: the one of this name, or the only one."""
    about = manifest(root)
    if not about.get("complete", True):
        command = generating_command(root, about) or "give the command that made it again"
        raise ValueError(f"{root} is half generated; this goes on where it stopped: {command}")
    found = versions(root)
    if version is not None and version not in found:
        raise ValueError(f"{root} has no version {version}; it has {', '.join(found) or 'none'}")
    if not found:
        hint = f"give the folder above: {root.parent}" if (root / "sample.json").exists() else "is it a nuScenes root?"
        raise ValueError(f"{root} needs a folder {VERSION_PREFIX}* of tables and has none; {hint}")
    if version is None and len(found) > 1:
        raise ValueError(
            f"{root} has the versions {', '.join(found)}; choose one, such as version={found[0]}"
            f" (data.version={found[0]} for train.py and eval.py)"
        )
    folder = root / (version or found[0])
    missing = [name for name in FIELDS if not (folder / f"{name}.json").exists()]
    if missing:
        raise ValueError(f"{folder} lacks {', '.join(f'{name}.json' for name in missing)}; {repair_advice(root)}")
    return folder


def versions(root: Path) -> list[str]:
    """Names of the folders ``v1.0-*`` of a root that hold tables."""
    folders = root.glob(f"{VERSION_PREFIX}*")
    return sorted(path.name for path in folders if any((path / f"{name}.json").exists() for name in FIELDS))


def manifest(root: Path) -> dict[str, Any]:
    """What a generated data set says of itself; {} for a real one."""
    path = root / MANIFEST_FILE
    if not path.exists():
        return {}
    try:
        about = read_json(path)
    except ValueError as error:
        raise ValueError(f"{error}; generate it again") from None
    if not isinstance(about, dict):
        raise ValueError(f"{path} is no manifest of generated data; generate it again")
    return about


def repair_advice(root: Path) -> str:
    """What to do about a data set of which something is missing or damaged."""
    about = manifest(root)
    if not about:
        return f"extract the archives of the data set into {root} again"
    command = generating_command(root, about) or command_line("-m data_gen", data__root=root)
    return f"delete {root} and generate it again: {command}"


def load_tables(folder: Path) -> Tables:
    """Every table that is read, checked. ValueError for the first value that is not what it must be."""
    tables = {name: _load_table(folder / f"{name}.json") for name in FIELDS}
    for name, records in tables.items():
        path = folder / f"{name}.json"
        for field, kind in (FIELDS[name] | OPTIONAL.get(name, {})).items():
            values = [record[field] for record in records.values() if field in record]
            if len(values) < len(records) and field in FIELDS[name]:
                lacking = next(token for token, record in records.items() if field not in record)
                raise ValueError(f"{path}: the record {lacking!r} has no {field}")
            if not kind.holds(values, tables):
                raise ValueError(f"{path}: {_first_wrong(records, field, kind, tables)}")
    return tables


def _first_wrong(records: dict[str, Record], field: str, kind: Field, tables: Tables) -> str:
    having = ((token, record[field]) for token, record in records.items() if field in record)
    token, value = next((token, value) for token, value in having if not kind.holds([value], tables))
    return f"the record {token!r} has {field}={shown(value)}, which is not {kind.must_be}"


def shown(value: Any) -> str:
    """A value as a message shows it."""
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def _load_table(path: Path) -> dict[str, Record]:
    records = read_json(path)
    if not isinstance(records, list) or not all(isinstance(record, dict) for record in records):
        raise ValueError(f"{path} is not a nuScenes table: a list of records with a token each")
    table: dict[str, Record] = {}
    for place, record in enumerate(records):
        token = record.get("token")
        if not isinstance(token, str) or not token:
            raise ValueError(f"{path}: record {place} (from 0) has token={shown(token)}, which is no text")
        if table.setdefault(token, record) != record:
            raise ValueError(f"{path}: two records have the token {token!r}")
    return table


def read_json(path: Path) -> Any:
    """The content of a JSON file. ValueError when it is damaged."""
    try:
        return json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is damaged or cut short ({error})") from None
