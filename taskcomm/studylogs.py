"""Which files of a folder are trial logs of a study: those of trials, not of practice, pages or server."""

import os
from pathlib import Path

from taskcomm.logs import LogError, log_files

PRACTICE = "practice"


def study_logs(path: str | os.PathLike[str]) -> list[Path]:
    """The log files of a study's folder (those in its `trials`), or of any folder or file of trial logs.

    Logs in a folder called `practice` are left out. Raises LogError where none is left.
    """
    given = Path(path)
    if (given / "study.toml").is_file() or (given / "participants.json").is_file():
        if not (given / "trials").is_dir():
            raise LogError(f"{given}: this study has no folder `trials` yet: no trial has begun")
        given = given / "trials"
    found = [file for file in log_files(given) if PRACTICE not in file.relative_to(given).parts[:-1]]
    if not found:
        raise LogError(f"{given}: its logs are of practice alone")
    return found
