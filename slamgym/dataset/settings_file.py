"""The settings in a folder that is being written: by them a run knows that it may go on there."""

import json
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from slamgym.core.errors import ConfigError, InputFileError
from slamgym.core.files import replace_file, storage_errors, temporary_name
from slamgym.dataset.format import FolderLayout

_SHOWN = 3
"""So many differences are named in an error."""


def claim_folder(
    layout: FolderLayout,
    settings: Mapping[str, Any],
    content: str,
    may_hold: Callable[[str], bool] = lambda _: False,
) -> None:
    """Write the settings into an empty folder, or find that it has them; the caller holds its lock.

    Args:
        layout: The folder.
        settings: What decides the content, in JSON form.
        content: What the folder is for, in the plural: ``pairs``.
        may_hold: Tells by the name what else may lie in a folder without settings.

    Raises:
        ConfigError: If the folder has other settings, or holds something else.
        InputFileError: If its settings can't be read.
        StorageError: If it can't be written.
    """
    with storage_errors(layout.root):
        names = sorted(path.name for path in layout.root.iterdir())
    if layout.config.name in names:
        _refuse_changes(layout, settings, content)
        return
    # A run that was killed here may have left the settings' temporary file.
    ours = (layout.lock.name, temporary_name(layout.config).name)
    unexpected = [name for name in names if name not in ours and not may_hold(name)]
    if unexpected:
        raise ConfigError(f"{layout.root}: holds {unexpected[0]} and no {content}; choose a new folder")
    with storage_errors(layout.root):
        replace_file(layout.config, (json.dumps(settings, indent=2) + "\n").encode())


def _refuse_changes(layout: FolderLayout, settings: Mapping[str, Any], content: str) -> None:
    before = _read(layout.config)
    changes = list(differences(before, json.loads(json.dumps(settings))))
    if changes:
        more = f"; and {len(changes) - _SHOWN} more" if len(changes) > _SHOWN else ""
        raise ConfigError(
            f"{layout.root}: holds {content} made with other settings ({'; '.join(changes[:_SHOWN])}{more}); "
            "choose a new folder, or the same settings to go on"
        )


def _read(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputFileError(
            path, f"can't be read ({error.strerror or error}); choose a new folder"
        ) from error
    except ValueError as error:
        raise InputFileError(path, f"is not JSON ({error}); choose a new folder") from error


def differences(before: Any, now: Any, where: str = "") -> Iterator[str]:
    """Name the settings that differ between two JSON values."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted(before.keys() | now.keys()):
            yield from differences(before.get(key), now.get(key), f"{where}.{key}" if where else key)
    elif before != now:
        yield f"{where} was {json.dumps(before)}, now {json.dumps(now)}"
