"""What is wrong with a bag that can't be opened, and what repairs one whose recording was cut off."""

from pathlib import Path

REPAIRS = {
    ".bag": "rosbag reindex FILE (ROS 1)",
    ".mcap": "mcap recover FILE -o WHOLE.mcap (https://mcap.dev/guides/cli)",
    ".db3": "sqlite3 FILE .recover | sqlite3 WHOLE.db3, then name WHOLE.db3",
}
"""Commands that keep what is whole of a bag whose recording was cut off, by its kind."""
CUT_OFF = (
    "not indexed",
    "index looks damaged",
    "magic",
    "Truncated",
    "footer",
    "malformed",
    "not a database",
    "decompress",
    "end too soon",
)
"""Parts of the library's sentences about such bags."""


def bag_fault(path: Path, error: Exception) -> str:
    """Why the library can't open a bag, with the command that repairs it if it may have been cut off."""
    reason = " ".join(str(error).split()) or type(error).__name__
    fault = f"is not a readable ROS bag ({reason[:200]})"
    files = sorted(path.iterdir()) if path.is_dir() else [path]
    repairs = [REPAIRS[file.suffix] for file in files if file.suffix in REPAIRS]
    if not repairs or not any(sign in reason for sign in CUT_OFF):
        return fault
    return f"{fault}; if the recording was cut off: {repairs[0]}"
