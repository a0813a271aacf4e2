"""The design of a study: what its researcher decides, as data (`study.toml`)."""

from pathlib import Path

from taskcomm.web.study.crosschecks import check as check
from taskcomm.web.study.reading import StudyError, from_toml, text_of
from taskcomm.web.study.structure import Condition as Condition
from taskcomm.web.study.structure import Consent as Consent
from taskcomm.web.study.structure import Design as Design
from taskcomm.web.study.structure import DesignError as DesignError
from taskcomm.web.study.structure import Item as Item
from taskcomm.web.study.structure import Operators as Operators
from taskcomm.web.study.structure import Timing as Timing
from taskcomm.web.study.structure import WorldDesign as WorldDesign


def load(path: Path) -> Design:
    """The design in a `study.toml`; DesignError says file, key and why."""
    try:
        text = text_of(path)
    except StudyError as error:
        raise DesignError(str(error)) from None
    return parsed(text, str(path))


def parsed(text: str, where: str = "study.toml") -> Design:
    """The design in the text of a `study.toml`.

    >>> parsed('name = "pilot"').teachers
    22
    """
    try:
        design = from_toml(text, Design, where)
        check(design)
    except DesignError as error:
        raise DesignError(f"{where}: {error}") from None
    except StudyError as error:
        raise DesignError(str(error)) from None
    return design
